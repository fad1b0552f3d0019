"""The numbers of the sensor model; each effect has one that turns it off."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from robust6dof.errors import InputError


@dataclass(frozen=True)
class StereoSensorConfig:
    """A stereo depth camera registered to its colour camera; the defaults are a D435i's.

    Disparities are in pixels of the stereo pair (848×480), image distances in pixels of the
    registered image.
    """

    stereo_focal_px: float = 424.0
    """Focal length of the stereo pair: 848 px wide with a field of view of 90°."""
    stereo_width_px: float = 848.0
    """Width of the stereo images; a match beyond their edge is invalid. 0: unlimited."""
    baseline_m: float = 0.05
    """Distance between the two imagers."""
    max_disparity_px: float = 126.0
    """Search range; nearer than focal · baseline / this, nothing is measured. 0: unlimited."""
    max_range_m: float = 10.0
    """Farther than this nothing is measured. 0: unlimited."""
    disparity_noise_px: float = 0.08
    """Standard deviation σ_d of the sub-pixel error; σ_z = z² σ_d / (focal · baseline)."""
    noise_correlation_px: tuple[float, float] = (6.0, 2.5)
    """Standard deviations (along x, along y) of the Gaussian that smooths white noise."""
    disparity_step_px: float = 1.0 / 32.0
    """Disparities are multiples of this. 0: continuous."""
    depth_unit_m: float = 0.001
    """Depth is a multiple of this. 0: continuous."""
    occlusion: bool = True
    """Whether what the right imager cannot see is invalid (a shadow left of each object)."""
    edge_fattening_px: float = 2.0
    """How far foreground depth grows over its outline: about half the matching window."""
    edge_jitter_px: float = 1.0
    """Standard deviation of that growth along the outline."""
    edge_disparity_px: float = 0.7
    """A disparity step larger than this is an outline."""
    grazing_deg: tuple[float, float] = (75.0, 87.0)
    """Incidence angles at which dropouts begin and are complete. (90, 90): never."""
    edge_dropout: float = 0.1
    """Probability of a dropout along outlines, where a window sees two surfaces."""
    fill_rate: float = 0.99
    """Share of a plain bright wall that is measured at `fill_range_m`. 1: no dropouts for want of
    light or texture."""
    fill_range_m: float = 2.0
    """Range at which `fill_rate` holds."""
    fill_level: float = 204.0
    """Luminance (of 255) of that wall."""
    match_window_px: float = 9.0
    """Side of the matching window, in pixels of the stereo pair."""
    shiny_dropout: float = 0.5
    """Probability that what saturates the colour (luminance above 250) blinds the stereo pair."""
    dropout_correlation_px: float = 3.8
    """Standard deviation of the Gaussian that makes holes out of single dropouts."""
    psf_sigma_px: float = 0.6
    """Standard deviation of the colour lens's blur."""
    exposure_gain: float = 1.0
    """Factor on all colours."""
    white_balance: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factor on red, green and blue."""
    shot_noise: float = 0.03
    """Variance of the colour noise per level of brightness [levels]."""
    read_noise: float = 1.2
    """Standard deviation of the colour noise in the dark [levels]."""
    readout_s: float = 0.0
    """Time from the first to the last row of the colour image (rolling shutter). 0: global."""

    def __post_init__(self) -> None:
        if self.stereo_focal_px <= 0 or self.baseline_m <= 0:
            raise InputError("the stereo pair needs a positive focal length and baseline")
        if not 0.0 < self.fill_rate <= 1.0 or self.match_window_px < 1.0:
            raise InputError("fill_rate must lie in 0 … 1 and match_window_px be 1 or more")
        if not (0.0 <= self.edge_dropout <= 1.0 and 0.0 <= self.shiny_dropout <= 1.0):
            raise InputError("edge_dropout and shiny_dropout are probabilities, 0 to 1")
        if self.fill_level <= 0 or self.shot_noise < 0 or self.read_noise < 0:
            raise InputError("fill_level must be positive, shot_noise and read_noise at least 0")
        if self.grazing_deg[0] > self.grazing_deg[1]:
            raise InputError("grazing_deg must read (begin, complete) in rising order")

    @classmethod
    def perfect(cls) -> StereoSensorConfig:
        """Every effect off: the frame is the rendering."""
        return cls(
            stereo_width_px=0.0,
            max_disparity_px=0.0,
            max_range_m=0.0,
            disparity_noise_px=0.0,
            disparity_step_px=0.0,
            depth_unit_m=0.0,
            occlusion=False,
            edge_fattening_px=0.0,
            edge_jitter_px=0.0,
            grazing_deg=(90.0, 90.0),
            edge_dropout=0.0,
            fill_rate=1.0,
            shiny_dropout=0.0,
            psf_sigma_px=0.0,
            shot_noise=0.0,
            read_noise=0.0,
        )

    @classmethod
    def d435i(cls) -> StereoSensorConfig:
        """The Intel RealSense D435i at 848×480, registered to colour."""
        return cls()

    @classmethod
    def preset(cls, name: str) -> StereoSensorConfig:
        """The preset `perfect` or `d435i`.

        Raises:
            InputError: another name.
        """
        if name not in ("perfect", "d435i"):
            raise InputError(f"no sensor preset {name!r}; there are perfect and d435i")
        return cls.perfect() if name == "perfect" else cls.d435i()

    def drawn(self, rng: np.random.Generator) -> StereoSensorConfig:
        """A copy such as another unit in another light would be: for one whole sequence."""
        balance = np.exp(rng.normal(0.0, 0.08, 3))
        red, green, blue = (float(x) for x in balance / balance[1])
        stretch = float(rng.uniform(1.0, 2.0))
        spread_x, spread_y = self.noise_correlation_px
        mean_spread = float(np.sqrt(spread_x * spread_y))
        return replace(
            self,
            disparity_noise_px=self.disparity_noise_px * float(rng.uniform(0.6, 1.5)),
            noise_correlation_px=(mean_spread * stretch, mean_spread / stretch),
            edge_fattening_px=self.edge_fattening_px * float(rng.uniform(0.5, 1.5)),
            edge_dropout=min(2.0 * self.edge_dropout * float(rng.random()), 1.0),
            fill_rate=1.0 - (1.0 - self.fill_rate) * float(10.0 ** rng.uniform(-1.0, 0.0)),
            shiny_dropout=min(2.0 * self.shiny_dropout * float(rng.random()), 1.0),
            exposure_gain=self.exposure_gain * float(np.exp(rng.normal(0.0, 0.2))),
            white_balance=(red, green, blue),
            shot_noise=self.shot_noise * float(rng.uniform(0.3, 2.0)),
            read_noise=self.read_noise * float(rng.uniform(0.5, 2.0)),
        )
