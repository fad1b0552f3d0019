"""Every public name is there, and importing the package alone imports nothing heavy."""

import subprocess
import sys

import robust6dof


def test_every_public_name_resolves() -> None:
    for name in robust6dof.__all__:
        assert getattr(robust6dof, name).__name__ == name
    assert sorted(robust6dof.__all__) == sorted(robust6dof._HOMES)


def test_an_unknown_name_is_an_attribute_error() -> None:
    assert not hasattr(robust6dof, "flyer")


def test_importing_the_package_is_light() -> None:
    script = "import sys, robust6dof; print({'torch', 'numpy', 'cv2'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "set()"
