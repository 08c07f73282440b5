"""Random shapes of the set `outside`: kinds that the catalogue's builders do not make."""

from collections.abc import Callable

import numpy as np
from manifold3d import CrossSection, Manifold
from numpy.random import Generator

SEED = 1848
_SIZE, _LEAST = (0.05, 0.13), 0.022  # m, longest and shortest side
_DENSITY, _MASS = (150.0, 900.0), (0.02, 0.5)  # kg/m3, kg


def blob(rng: Generator) -> Manifold:
    """A sphere swollen and dented by a few smooth bumps."""
    ways = rng.normal(size=(rng.integers(3, 8), 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    heights, widths = rng.uniform(-0.3, 0.45, len(ways)), rng.uniform(1.5, 6.0, len(ways))

    def bumps(points: np.ndarray) -> np.ndarray:
        """Return unit points (N, 3) moved out and in."""
        swell = (heights * np.exp(widths * (points @ ways.T - 1.0))).sum(axis=1)
        return points * (1.0 + swell)[:, None]

    return Manifold.sphere(1.0, 48).warp_batch(bumps).scale(rng.uniform((0.6, 0.6, 0.5), 1.0))


def extrusion(rng: Generator) -> Manifold:
    """A star-like outline, drawn up with a taper and a twist."""
    outline = _outline(rng, int(rng.integers(3, 11)), rng.uniform(0.0, 0.45))
    return outline.extrude(rng.uniform(0.5, 3.0), 24, rng.uniform(-70.0, 70.0), (rng.uniform(0.5, 1.0),) * 2)


def revolution(rng: Generator) -> Manifold:
    """A smooth profile about an axis: vases, spindles, knobs."""
    height = np.linspace(0.0, rng.uniform(1.0, 4.0), 40)
    waves = sum(
        rng.uniform(-0.35, 0.35) * np.sin((k + 1) * np.pi * height / height[-1] + rng.uniform(0, 6.28))
        for k in range(4)
    )
    radius = np.clip(0.7 + waves, 0.15, None)
    profile = [(0.0, 0.0), *zip(radius.tolist(), height.tolist(), strict=True), (0.0, float(height[-1]))]
    return CrossSection([profile]).revolve(48)


def pieces(rng: Generator) -> Manifold:
    """Two to five solids joined, and one to three holes: toys, fittings, tools."""
    whole = _solid(rng)
    for _ in range(int(rng.integers(1, 5))):
        whole += _solid(rng).rotate(rng.uniform(0.0, 360.0, 3)).translate(rng.uniform(-0.6, 0.6, 3))
    for _ in range(int(rng.integers(1, 4))):
        drill = Manifold.cylinder(8.0, rng.uniform(0.08, 0.25), circular_segments=24, center=True)
        whole -= drill.rotate(rng.uniform(0.0, 360.0, 3)).translate(rng.uniform(-0.5, 0.5, 3))
    return max(whole.decompose(), key=lambda part: part.volume())


def handled(rng: Generator) -> Manifold:
    """A body with a handle at its side: a bar or a loop."""
    body = (revolution if rng.random() < 0.5 else extrusion)(rng)
    x0, y0, z0, x1, y1, z1 = body.bounding_box()
    tall, thick = z1 - z0, rng.uniform(0.08, 0.16) * (z1 - z0)
    side = np.array([x1, 0.5 * (y0 + y1), z0 + tall * rng.uniform(0.4, 0.7)])
    if rng.random() < 0.5:
        length = rng.uniform(0.8, 1.6) * max(x1 - x0, tall)
        bar = Manifold.cylinder(length, 1.2 * thick, 0.8 * thick, 24).rotate((0.0, 90.0, 0.0))
        return body + bar.translate(side - (0.3 * (x1 - x0), 0.0, 0.0))
    ring = CrossSection.circle(thick, 16).translate((rng.uniform(0.25, 0.4) * tall, 0.0)).revolve(32)
    return body + ring.rotate((90.0, 0.0, 0.0)).translate(side)


def walled(rng: Generator) -> Manifold:
    """Thin walls about a hollow: bowls, trays, caps, pipes."""
    outline = _outline(rng, int(rng.integers(5, 24)), rng.uniform(0.0, 0.15))
    height, wall = rng.uniform(0.6, 2.2), rng.uniform(0.06, 0.14)
    top = (rng.uniform(0.75, 1.3),) * 2
    outer = outline.extrude(height, 1, 0.0, top)
    floor = -0.1 if rng.random() < 0.25 else wall
    inner = outline.offset(-wall).extrude(height + 0.2, 1, 0.0, top).translate((0.0, 0.0, floor))
    return outer - inner


_KINDS: tuple[Callable[[Generator], Manifold], ...] = (blob, extrusion, revolution, pieces, handled, walled)


def shape(number: int) -> tuple[Manifold, str, float]:
    """Return shape `number`, m, the name of its kind, and its mass, kg."""
    kind = _KINDS[number % len(_KINDS)]
    for attempt in range(100):
        rng = np.random.default_rng([SEED, number, attempt])
        solid = _sized(kind(rng), rng)
        if solid is not None:
            mass = float(np.clip(solid.volume() * rng.uniform(*_DENSITY), *_MASS))
            return solid, kind.__name__, round(mass, 3)
    raise RuntimeError(f"no shape of kind {kind.__name__} for number {number}")


def _sized(solid: Manifold, rng: Generator) -> Manifold | None:
    low, high = np.array(solid.bounding_box()).reshape(2, 3)
    sides = high - low
    if solid.is_empty() or len(solid.decompose()) != 1:
        return None
    factor = rng.uniform(*_SIZE) / sides.max()
    if factor * sides.min() < _LEAST:
        return None
    return solid.translate(-0.5 * (low + high)).scale((factor,) * 3)


def _outline(rng: Generator, corners: int, depth: float) -> CrossSection:
    angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.25, 0.25, corners)) / corners
    radius = 1.0 - depth * rng.random(corners)
    points = np.column_stack([radius * np.cos(angle), rng.uniform(0.6, 1.0) * radius * np.sin(angle)])
    return CrossSection([points.tolist()])


def _solid(rng: Generator) -> Manifold:
    if rng.random() < 0.5:
        return Manifold.cube(rng.uniform(0.4, 1.4, 3), center=True)
    return Manifold.cylinder(rng.uniform(0.4, 1.8), *rng.uniform(0.2, 0.7, 2), 32, center=True)
