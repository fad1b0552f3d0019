"""Every function that the paper map names exists, and the tracker's symbols are all in it."""

import importlib
import pkgutil
import re
from dataclasses import fields
from pathlib import Path

import pytest

import robust6dof
from robust6dof.network.config import NetworkConfig
from robust6dof.training.losses import LossConfig

MAP = (Path(__file__).parents[1] / "docs" / "paper-map.md").read_text()
TRACKER = MAP.split("## Robot")[0]
_PACKAGES = ("network", "solver", "training", "tracking", "geometry", "robot", "servo", "shapes")
_CODE = re.compile(r"`([A-Za-z_][\w.]*)`")


def second_columns(text):
    """The cells that say where a row of a table is implemented."""
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [row[1] for row in rows if len(row) > 1 and row[1] != "Function"]


def modules():
    """Every module of the packages that the map speaks of, by its short names."""
    found = {}
    for package in _PACKAGES:
        for info in pkgutil.walk_packages([str(Path(robust6dof.__path__[0]) / package)]):
            found.setdefault(info.name, []).append(f"robust6dof.{package}.{info.name}")
            found[f"{package}.{info.name}"] = [f"robust6dof.{package}.{info.name}"]
        found[package] = [f"robust6dof.{package}"]
    return found


MODULES = modules()


def has(thing, names):
    for name in names:
        if name not in vars(thing).get("__annotations__", {}) and not hasattr(thing, name):
            return False
        thing = getattr(thing, name, object())
    return True


def resolves(name, beside=""):
    """`package.module.function`, `module.function`, `function` or `Class.method`.

    A bare name after a longer one in its cell may be of the same module or class.
    """
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        for module in MODULES.get(".".join(parts[:cut]), []):
            if has(importlib.import_module(module), parts[cut:]):
                return True
    if beside and "." not in name and resolves(f"{beside.rpartition('.')[0]}.{name}"):
        return True
    places = {place for several in MODULES.values() for place in several}
    return any(
        place.startswith(("robust6dof.robot.", "robust6dof.servo.", "robust6dof.training.losses"))
        and has(importlib.import_module(place), parts)
        for place in sorted(places)
    )


def named():
    """Each name of the map with the longer one before it in its cell."""
    found = set()
    for cell in second_columns(MAP):
        beside = ""
        for name in _CODE.findall(cell):
            found.add((name, beside))
            beside = name if "." in name else beside
    return sorted(found)


NAMES = named()


@pytest.mark.parametrize(("name", "beside"), NAMES)
def test_what_the_map_names_exists(name, beside):
    assert resolves(name, beside), f"docs/paper-map.md names `{name}`, which is nowhere"


def test_a_wrong_name_would_be_found():
    assert len(NAMES) > 40
    for name in ("losses.no_such_loss", "matching.DualSoftmax", "no_such_function"):
        assert not resolves(name)


SYMBOLS = """
    P_r N_r ρ_j I(t) P(t) F_c F_g F_q F_k F_v φ α X_c Y_c F̄_g f_g^1 h F_obj Ḟ S_Δt S̄_Δt f̈ F_temp
    F_pr S_pr S̄_pr f⃛ F_aug F̃_aug FFN M n L_aux P_r^K T_XY T_YZ T_XZ d_T F̃_kp S_kp τ P_c θ_c M_c
    M_c^gt L_mvc L_c L_tra L_rot ΔP ΔR ΔT
"""


@pytest.mark.parametrize("symbol", SYMBOLS.split())
def test_every_symbol_of_the_papers_tracker_is_in_the_map(symbol):
    assert re.search(rf"(?<!\w){re.escape(symbol)}(?!\w)", TRACKER), symbol


@pytest.mark.parametrize(
    "name",
    [
        field.name
        for config in (NetworkConfig, LossConfig)
        for field in fields(config)
        if "Literal" in str(field.type) or field.type == "bool"
    ],
)
def test_every_reading_that_can_be_chosen_is_in_the_map(name):
    assert f"`{name}" in TRACKER, f"docs/paper-map.md does not say what {name} departs from"
