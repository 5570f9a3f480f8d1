"""Ground under a flight: flat, procedural from a seed, or a height map.

The formulas are those of ``sim_c/world/terrain.h``. Every operation is repeated here in the same
order. Heights, slopes and curvatures are therefore the same bits that the simulator flew over.
"""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path

import numpy as np

from ges.errors import GesError, UsageError

_MASK64 = (1 << 64) - 1
_DIRECTIONS = ((1.0, 0.0), (0.0, 1.0))
_UNDULATION = 4.201355091181271  # 7^3.5 / 216: s (1 - s^2)^3 peaks at s^2 = 1/7
_WAVE_PEAKS = 1.0 / 2.344
KINDS = {"flat": 0.0, "procedural": 1.0, "grid": 2.0}


@dataclasses.dataclass(frozen=True)
class ProceduralShape:
    """Numbers that lay out procedural ground.

    Attributes
    ----------
    terrain_length_m : length along x of the strip that holds the features.
    terrain_features_min, terrain_features_max : range of the number of features.
    terrain_amplitude_min_m, terrain_amplitude_max_m : range of the height of a feature.
    terrain_width_min_m, terrain_width_max_m : range of the width of a feature along y.
    terrain_roughness_m : amplitude of the waves everywhere.
    terrain_roughness_length_m : wavelength of these waves.
    """

    terrain_length_m: float = 2500.0
    terrain_features_min: float = 800.0
    terrain_features_max: float = 1499.0
    terrain_amplitude_min_m: float = 0.03
    terrain_amplitude_max_m: float = 0.17
    terrain_width_min_m: float = 2.3
    terrain_width_max_m: float = 4.6
    terrain_roughness_m: float = 0.002
    terrain_roughness_length_m: float = 0.5


class _Xorshift32:
    """Marsaglia 2003, as in sim_c/core/random.h."""

    def __init__(self, seed: int) -> None:
        # SplitMix64 spreads neighbouring seeds apart; | 1, as a state of 0 would stay 0
        z = (seed + 0x9E3779B97F4A7C15) & _MASK64
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK64
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK64
        self.state = ((z ^ (z >> 31)) & 0xFFFFFFFF) | 1

    def bits(self) -> int:
        x = self.state
        x ^= (x << 13) & 0xFFFFFFFF
        x ^= x >> 17
        x ^= (x << 5) & 0xFFFFFFFF
        self.state = x
        return x

    def uniform(self) -> float:
        return float(self.bits()) * (1.0 / 4294967296.0)

    def between(self, low: float, high: float) -> float:
        return low + (high - low) * self.uniform()


@dataclasses.dataclass(frozen=True)
class _Layout:
    slot_m: float
    features: np.ndarray  # (n, 6): xc, 1/lx, yc, 1/ly, a0, a1
    waves: np.ndarray  # (2, 3): cycles per metre along x and y, phase
    roughness: float


def _draw_waves(draw: _Xorshift32, wavelength_m: float) -> np.ndarray:
    waves = np.empty((len(_DIRECTIONS), 3))
    for k, (dx, dy) in enumerate(_DIRECTIONS):
        cycles = draw.between(0.8, 1.25) / wavelength_m
        mix = draw.between(-0.5, 0.5)
        waves[k] = cycles * (dx - mix * dy), cycles * (dy + mix * dx), draw.uniform()
    return waves


def _draw_feature(
    draw: _Xorshift32, shape: ProceduralShape, slot: float, i: int
) -> tuple[float, ...]:
    lx = slot * draw.between(0.25, 0.49)
    # each feature stays within its slot, so that no more than one is under any point
    xc = slot * (float(i) + 0.5) + (0.499 * slot - lx) * draw.between(-1.0, 1.0)
    ly = 0.5 * draw.between(shape.terrain_width_min_m, shape.terrain_width_max_m)
    yc = ly * draw.between(-0.3, 0.3)
    amplitude = draw.between(shape.terrain_amplitude_min_m, shape.terrain_amplitude_max_m)
    kind = draw.bits() % 4
    a0 = amplitude if kind == 0 else -amplitude if kind == 1 else 0.0
    a1 = 0.0 if kind < 2 else (amplitude if kind == 2 else -amplitude) * _UNDULATION
    return xc, 1.0 / lx, yc, 1.0 / ly, a0, a1


@functools.lru_cache(maxsize=512)
def _layout(seed: int, shape: ProceduralShape) -> _Layout:
    draw = _Xorshift32(seed)
    low, high = int(shape.terrain_features_min), int(shape.terrain_features_max)
    n = low + draw.bits() % (high - low + 1)
    slot = shape.terrain_length_m / float(n)
    waves = _draw_waves(draw, shape.terrain_roughness_length_m)
    features = np.array([_draw_feature(draw, shape, slot, i) for i in range(n)])
    return _Layout(slot, features, waves, shape.terrain_roughness_m * _WAVE_PEAKS)


def _bump(s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    m = 1.0 - s * s
    m = np.where(m > 0.0, m, 0.0)
    m2 = m * m
    return m2 * m, -6.0 * s * m2, 24.0 * (s * s) * m - 6.0 * m2


@dataclasses.dataclass(frozen=True)
class Ground:
    """Ground at n points.

    Attributes
    ----------
    height_m : (n,) height in the world.
    slope_x, slope_y : (n,) derivative of the height along x and y of the world.
    curvature_1_m : (n,) Laplacian of the height; positive in hollows.
    """

    height_m: np.ndarray
    slope_x: np.ndarray
    slope_y: np.ndarray
    curvature_1_m: np.ndarray

    @property
    def slope(self) -> np.ndarray:
        """Steepness (n,), the tangent of the angle of slope."""
        return np.sqrt(self.slope_x * self.slope_x + self.slope_y * self.slope_y)


@dataclasses.dataclass(frozen=True)
class Terrain:
    """Ground of a flight; made with :meth:`flat`, :meth:`procedural` or :meth:`grid`.

    Attributes
    ----------
    kind : a key of :data:`KINDS`.
    z_m : height of flat ground in the world; added to the heights of other kinds.
    seed : of procedural ground; None for the seed of the flight.
    shape : of procedural ground.
    x_m, y_m, heights_m : height map, axes (k,) and (m,), heights (m, k); None for other kinds.
    """

    kind: str
    z_m: float = 0.0
    seed: int | None = None
    shape: ProceduralShape = ProceduralShape()
    x_m: np.ndarray | None = None
    y_m: np.ndarray | None = None
    heights_m: np.ndarray | None = None

    @classmethod
    def flat(cls, z_m: float = 0.0) -> Terrain:
        """Make level ground.

        Parameters
        ----------
        z_m : height in the world.
        """
        return cls("flat", z_m=float(z_m))

    @classmethod
    def procedural(
        cls, seed: int | None = None, shape: ProceduralShape = ProceduralShape()
    ) -> Terrain:
        """Make irregular ground from a seed.

        Parameters
        ----------
        seed : None for the seed of the flight.
        shape : numbers that lay it out.
        """
        return cls("procedural", seed=seed, shape=shape)

    @classmethod
    def grid(cls, x_m: np.ndarray, y_m: np.ndarray, heights_m: np.ndarray) -> Terrain:
        """Make ground from a height map, interpolated bilinearly.

        Outside the map the value at its edge holds.

        Parameters
        ----------
        x_m, y_m : axes in the world, (k,) and (m,), uniformly spaced and increasing.
        heights_m : (m, k) heights in the world.

        Raises
        ------
        UsageError
            When an axis is not uniform, or heights are not finite or of another shape.
        """
        x_m, y_m, heights_m = (np.asarray(a, dtype=float) for a in (x_m, y_m, heights_m))
        for name, axis in (("x_m", x_m), ("y_m", y_m)):
            step = np.diff(axis)
            if (
                axis.ndim != 1
                or len(axis) < 2
                or not np.all(step > 0)
                or np.ptp(step) > 1e-6 * step.mean() + 1e-9
            ):
                raise UsageError(
                    f"terrain axis {name} must hold two or more uniformly increasing values"
                )
        if heights_m.shape != (len(y_m), len(x_m)) or not np.all(np.isfinite(heights_m)):
            raise UsageError(
                f"terrain heights have shape {heights_m.shape}; needed are finite values of shape"
                f" {(len(y_m), len(x_m))}"
            )
        return cls("grid", x_m=x_m, y_m=y_m, heights_m=heights_m)

    @classmethod
    def load(cls, path: str | Path) -> Terrain:
        """Read a height map, as :meth:`grid` takes it.

        Parameters
        ----------
        path : .npz file with ``x_m`` (k,), ``y_m`` (m,) and ``z_m`` (m, k).

        Raises
        ------
        GesError
            When the file cannot be read or has other content.
        """
        try:
            with np.load(path) as stored:
                return cls.grid(stored["x_m"], stored["y_m"], stored["z_m"])
        except UsageError:
            raise
        except Exception as error:
            # numpy and zip meet a damaged file with errors of many kinds
            raise GesError(
                f"{Path(path).name} is not a terrain file (x_m, y_m, z_m[y, x] in .npz): {error}"
            ) from error

    def parameters(self) -> dict[str, float]:
        """Give the ground as parameters of the simulator.

        Returns
        -------
        Values by name of :func:`ges.simulator.parameters.parameters`; a height map itself is passed
        apart.
        """
        values = {"terrain_kind": KINDS[self.kind], "terrain_z_m": self.z_m}
        if self.kind == "procedural":
            values |= dataclasses.asdict(self.shape)
            values["terrain_seed"] = -1.0 if self.seed is None else float(self.seed)
        return values

    def at(self, x_m: np.ndarray, y_m: np.ndarray) -> Ground:
        """Compute the ground at n points.

        Parameters
        ----------
        x_m, y_m : (n,) coordinates in the world.

        Raises
        ------
        UsageError
            When the ground takes the seed of its flight, which is not known here.
        """
        x_m, y_m = np.broadcast_arrays(np.asarray(x_m, dtype=float), np.asarray(y_m, dtype=float))
        if self.kind == "procedural":
            return self._procedural_at(x_m, y_m)
        axes = self.height_map()
        if axes is not None:
            return self._grid_at(axes, x_m, y_m)
        zero = np.zeros_like(x_m)
        return Ground(zero + self.z_m, zero, zero, zero)

    def _procedural_at(self, x: np.ndarray, y: np.ndarray) -> Ground:
        if self.seed is None:
            raise UsageError(
                "this terrain takes the seed of its flight; name a seed to look at it alone"
            )
        layout = _layout(self.seed, self.shape)
        # the edge between two slots that is nearest, then the side of it
        left = np.rint(x * (1.0 / layout.slot_m)) - 1.0
        edge = (left + 1.0) * layout.slot_m
        slot = left + (x >= edge)
        inside = (slot >= 0) & (slot < len(layout.features))
        f = layout.features[np.where(inside, slot, 0).astype(int)]
        # outside all slots a feature without height
        f = np.where(inside[..., None], f, np.array([0.0, 1.0, 0.0, 1.0, 0.0, 0.0]))
        ground = _add_feature(f, x, y, self.z_m)
        for wave in layout.waves:
            ground = _add_wave(ground, wave, layout.roughness, x, y)
        return Ground(*ground)

    def height_map(self) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """Give the height map.

        Returns
        -------
        Axes ``x_m`` (nx,) and ``y_m`` (ny,) and heights (ny, nx), m; None for ground of another
        kind.
        """
        if self.x_m is None or self.y_m is None or self.heights_m is None:
            return None
        return self.x_m, self.y_m, self.heights_m

    def _grid_at(
        self, axes: tuple[np.ndarray, np.ndarray, np.ndarray], x: np.ndarray, y: np.ndarray
    ) -> Ground:
        x_m, y_m, z = axes
        dx, dy = x_m[1] - x_m[0], y_m[1] - y_m[0]
        ny, nx = z.shape
        fx = np.clip((x - x_m[0]) / dx, 0.0, nx - 1.0)
        fy = np.clip((y - y_m[0]) / dy, 0.0, ny - 1.0)
        # the last cell holds the upper edge, too
        ix, iy = np.minimum(fx.astype(int), nx - 2), np.minimum(fy.astype(int), ny - 2)
        u, v = fx - ix, fy - iy
        z00, z01, z10, z11 = z[iy, ix], z[iy, ix + 1], z[iy + 1, ix], z[iy + 1, ix + 1]
        # bilinear: the slope is that of the cell, its Laplacian is zero
        south, north = z00 + u * (z01 - z00), z10 + u * (z11 - z10)
        west, east = z00 + v * (z10 - z00), z01 + v * (z11 - z01)
        height = self.z_m + (south + v * (north - south))
        return Ground(height, (east - west) / dx, (north - south) / dy, np.zeros_like(height))


def _add_feature(f: np.ndarray, x: np.ndarray, y: np.ndarray, z: float) -> tuple[np.ndarray, ...]:
    xc, ilx, yc, ily, a0, a1 = (f[..., k] for k in range(6))
    s, t = (x - xc) * ilx, (y - yc) * ily
    (b, b1, b2), (q, q1, q2) = _bump(s), _bump(t)
    a = a0 + a1 * s
    # Leibniz' rule for p = (a0 + a1 s) b(s)
    p1, p2, p = a1 * b + a * b1, 2.0 * a1 * b1 + a * b2, a * b
    return (
        z + p * q,
        0.0 + p1 * q * ilx,
        0.0 + p * q1 * ily,
        0.0 + (p2 * q * (ilx * ilx) + p * q2 * (ily * ily)),
    )


def _add_wave(
    ground: tuple[np.ndarray, ...], w: np.ndarray, amplitude: float, x: np.ndarray, y: np.ndarray
) -> tuple[np.ndarray, ...]:
    height, gx, gy, laplacian = ground
    u = x * w[0] + y * w[1] + w[2]
    t = u - np.rint(u)
    # a quintic for the sine: 0 at t = +-1/2 with equal slopes and no curvature there, so it joins
    t2 = t * t
    slope = amplitude * (7.0 + t2 * (-120.0 + 240.0 * t2))
    return (
        height + amplitude * (t * (7.0 + t2 * (-40.0 + 48.0 * t2))),
        gx + w[0] * slope,
        gy + w[1] * slope,
        laplacian + ((w[0] * w[0] + w[1] * w[1]) * amplitude) * (t * (-240.0 + 960.0 * t2)),
    )
