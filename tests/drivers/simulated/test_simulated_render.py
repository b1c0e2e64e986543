"""The simulated world and renderer against independent computations."""

import math

import cv2
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DriverError
from drivers.simulated.world import surfaces
from drivers.simulated.world.facets import Facet
from drivers.simulated.world.lens import DOWN, Lens
from drivers.simulated.world.render import Renderer, frame_rate
from drivers.simulated.world.sequences import plane_sequence
from drivers.simulated.world.textures import MATERIALS, pyramid, texture
from drivers.simulated.world.world import World, build_world

WIDE = Lens(
    320,
    240,
    np.array([[256.0, 0, 161.0], [0, 255.0, 118.0], [0, 0, 1]]),
    np.array([-0.21, 0.07, 1e-3, -5e-4, 0.0]),
)


def rotation(roll: float, pitch: float, yaw: float) -> np.ndarray:
    rx, _ = cv2.Rodrigues(np.array([roll, 0.0, 0.0]))
    ry, _ = cv2.Rodrigues(np.array([0.0, pitch, 0.0]))
    rz, _ = cv2.Rodrigues(np.array([0.0, 0.0, yaw]))
    return rz @ ry @ rx


def triangles_of(facets: list[Facet]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First corner and both edges from it of every triangle, each (n, 3)."""
    found = [
        (f.vertices[0], f.vertices[k] - f.vertices[0], f.vertices[k + 1] - f.vertices[0])
        for f in facets
        for k in range(1, len(f.vertices) - 1)
    ]
    corner, first, second = (np.array(part) for part in zip(*found, strict=True))
    return corner, first, second


def moller_trumbore(
    triangles: tuple[np.ndarray, np.ndarray, np.ndarray], origin: np.ndarray, direction: np.ndarray
) -> float:
    """Distance along a ray to the nearest triangle that faces it: no code shared with the renderer."""
    corner, first, second = triangles
    p = np.cross(direction, second)
    from_corner = origin - corner
    q = np.cross(from_corner, first)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1 / (first * p).sum(axis=1)
        t, u, v = (
            (second * q).sum(axis=1) * scale,
            (from_corner * p).sum(axis=1) * scale,
            q @ direction * scale,
        )
    faces = (from_corner * np.cross(first, second)).sum(axis=1) > 0
    hit = faces & (t > 0) & (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return float(t[hit].min(initial=math.inf))


SCENES = {
    "stairs": (surfaces.stairs(), (1.2, 0.3, -3.6)),
    "rubble": (surfaces.level() + surfaces.rubble(count=60, length=4, width=4), (0.1, -0.2, -2.4)),
    "roof": (surfaces.level() + surfaces.roof(), (2.0, 5.0, -9.0)),
    "rolling": (surfaces.level(height=-5) + surfaces.rolling(size=12, cell=1.0), (0.5, 0.5, -4.0)),
    "step": (surfaces.step(height=0.4, bearing_deg=30), (0.0, 0.0, -2.0)),
}


@pytest.mark.parametrize("samples", [1, 2])
@pytest.mark.parametrize("name", SCENES)
def test_depth_is_that_of_rays_cast_one_by_one(name: str, samples: int) -> None:
    facets, place = SCENES[name]
    position = np.array(place)
    ned_from_camera = rotation(0.06, -0.11, 0.7) @ DOWN
    renderer = Renderer(World(facets), WIDE, samples=samples)
    depth, _ = renderer.depth(position, ned_from_camera)
    rng = np.random.default_rng(3)
    rows, columns = rng.integers(0, 240, 15), rng.integers(0, 320, 15)
    rays, triangles = renderer.rays(), triangles_of(facets)
    for r, c in zip(rows, columns, strict=True):
        ray = rays[r, c]
        expected = moller_trumbore(triangles, position, ned_from_camera @ ray)
        assert depth[r, c] == pytest.approx(expected, rel=2e-5), (r, c)
        index, distance = renderer.cast(position, ned_from_camera @ ray)
        assert distance == pytest.approx(expected, rel=1e-9)
        assert index >= 0


def test_depth_stays_finite_on_faces_seen_edge_on() -> None:
    """Over a box the faces are seen all but edge-on; no depth lies outside the scene."""
    facets = surfaces.level() + surfaces.rubble(seed=1, count=160, length=8, width=8)
    renderer = Renderer(World(facets), Lens.from_fov(256, 256, 50), texture_size=64)
    for k in range(0, 25, 2):
        height = 4.0 - 0.1 * k
        depth, _ = renderer.depth(np.array([0.03 * k - 0.5, 0.1, -height]), DOWN)
        assert depth.min() > height - 0.8
        assert depth.max() < height + 1e-3


def test_rays_invert_the_lens_to_a_millionth_of_a_pixel() -> None:
    x, y = WIDE.rays()
    back = WIDE.project(np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64))
    u, v = np.meshgrid(np.arange(320.0), np.arange(240.0))
    # The ray tables are single precision: 6e-8 of a ray at 256 px.
    assert np.abs(back - np.stack([u.ravel(), v.ravel()], axis=1)).max() < 3e-5
    pixels = np.array([[0.0, 0.0], [319.0, 239.0], [12.3, 200.7]])
    assert np.abs(WIDE.project(WIDE.undistort(pixels)) - pixels).max() < 1e-6


def test_a_lens_without_inverse_is_refused() -> None:
    lens = Lens(320, 240, WIDE.matrix, np.array([-2.5, 0.0, 0.0, 0.0, 0.0]))
    with pytest.raises(DriverError, match="no inverse"):
        lens.rays()


@examples(6)
@given(
    # steeper, texels run together where the plane is far, and what is left of interpolation grows
    inclination=st.floats(-40, 40),
    uphill=st.floats(0, 360),
    roll=st.floats(-0.2, 0.2),
    pitch=st.floats(-0.2, 0.2),
    yaw=st.floats(-3, 3),
)
def test_a_plane_moves_by_its_exact_homography(
    inclination: float, uphill: float, roll: float, pitch: float, yaw: float
) -> None:
    """The second picture is the first one warped by H = K (R + t n'/d) K^-1, up to interpolation."""
    lens = Lens.from_fov(160, 120, 50)
    # Texels of 4 cm under pixels of 2 cm: the picture is smooth enough to be interpolated.
    ground = surfaces.ramp(inclination_deg=inclination, uphill_deg=uphill, material="noise", texture_m=40)
    renderer = Renderer(World(ground), lens)
    first = rotation(roll, pitch, yaw) @ DOWN
    second = rotation(roll + 0.02, pitch - 0.03, yaw + 0.01) @ DOWN
    p1, p2 = np.array([0.1, 0.2, -3.0]), np.array([0.15, 0.12, -2.9])
    slope = math.tan(math.radians(inclination))
    up = math.radians(uphill)
    normal = np.array([slope * math.cos(up), slope * math.sin(up), 1.0]) / math.hypot(slope, 1)
    # Plane: normal . X = 0 in NED (through the origin); in the second camera: n . x = d.
    n2 = second.T @ normal
    d2 = -normal @ p2
    first_from_second = first.T @ second
    t = first.T @ (p2 - p1)
    homography = lens.matrix @ (first_from_second + np.outer(t, n2) / d2) @ np.linalg.inv(lens.matrix)
    a = renderer.image(p1, first)
    b = renderer.image(p2, second)
    x, y = np.meshgrid(np.arange(160.0), np.arange(120.0))
    from_second = np.stack([x, y, np.ones_like(x)], axis=-1) @ homography.T
    mx, my = (from_second[..., k] / from_second[..., 2] for k in (0, 1))
    known = (mx > 5) & (mx < 154) & (my > 5) & (my < 114)
    assert known.mean() > 0.4

    def error(dx: float, dy: float) -> float:
        at = ((mx + dx).astype(np.float32), (my + dy).astype(np.float32))
        difference = cv2.remap(a, *at, cv2.INTER_LANCZOS4) - b
        return float(np.sqrt(np.mean(difference[known] ** 2)))

    assert error(0, 0) < 0.06 * b[known].std()
    # Off by a tenth of a pixel is worse, whichever way: the geometry is right to some hundredths.
    for dx, dy in ((0.1, 0), (-0.1, 0), (0, 0.1), (0, -0.1)):
        assert error(dx, dy) > 1.05 * error(0, 0)


@pytest.mark.parametrize("fine", [False, True])
@pytest.mark.parametrize("height", [8.0, 40.0])
def test_a_distant_fine_texture_gives_the_true_flow(height: float, fine: bool) -> None:
    """Texels far smaller than a pixel: without filtering the flow would be noise or zero."""
    lens = Lens.from_fov(256, 256, 50)
    renderer = Renderer(World(surfaces.level(material="gravel")), lens, fine=fine)
    texels_a_pixel = height / lens.focal_px / (4 / 1024)
    assert texels_a_pixel > 4
    shift = np.array([0.3, -0.4])
    start = np.array([0.3, 0.4, -height])
    there = start + height / lens.focal_px * np.array([shift[1], -shift[0], 0.0])
    a, b = (np.rint(renderer.image(p, DOWN)).astype(np.uint8) for p in (start, there))
    corners = cv2.goodFeaturesToTrack(a, 150, 0.01, 7, mask=np.pad(np.ones((216, 216), np.uint8), 20))
    assert len(corners) > 80
    # A little blur takes the tracker's own bias (its pull to whole pixels, 0.03 px here) out of the test.
    a, b = (cv2.GaussianBlur(p, (0, 0), 1.0) for p in (a, b))
    tracked, status, _ = cv2.calcOpticalFlowPyrLK(a, b, corners, None, winSize=(15, 15), maxLevel=2)
    flow = (tracked - corners)[status.ravel() == 1].reshape(-1, 2)
    assert np.abs(np.median(flow, axis=0) - shift).max() < 0.02
    assert np.percentile(np.linalg.norm(flow - shift, axis=1), 90) < 0.15


def test_fast_and_fine_pictures_agree() -> None:
    facets, place = SCENES["stairs"]
    world, position = World(facets), np.array(place)
    fast, fine = (Renderer(world, WIDE, fine=f).image(position, DOWN) for f in (False, True))
    assert np.mean(np.abs(fast - fine)) < 0.1 * fine.std()


def test_no_crack_shows_between_the_facets_of_a_mesh() -> None:
    world = World(surfaces.rolling(size=30, cell=0.5, amplitude=0.3))
    renderer = Renderer(world, WIDE)
    for yaw in (0.0, 0.3, 1.234):
        _, owner = renderer.depth(np.array([0.2, 0.1, -5.0]), rotation(0.05, 0.1, yaw) @ DOWN)
        assert (owner >= 0).all()


def test_the_sky_shows_where_nothing_is() -> None:
    renderer = Renderer(World(surfaces.level(size=1.0)), Lens.from_fov(160, 120, 60))
    depth, owner = renderer.depth(np.array([0.0, 0.0, -3.0]), DOWN)
    assert np.isinf(depth[0, 0])
    assert owner[0, 0] == -1
    assert np.isfinite(depth[60, 80])
    up = renderer.image(np.array([0.0, 0.0, -3.0]), rotation(math.pi, 0, 0) @ DOWN)
    assert np.ptp(up) == 0


def test_heights_of_the_world() -> None:
    world = World(surfaces.stairs(count=18, rise=0.17, run=0.29))
    assert world.height_at(-1, 0) == pytest.approx(18 * 0.17)
    assert world.height_at(0.1, 5) == pytest.approx(17 * 0.17)
    assert world.height_at(0.4, -5) == pytest.approx(16 * 0.17)
    assert world.height_at(18 * 0.29 + 1, 0) == pytest.approx(0)
    assert world.height_at(1e5, 0) == -math.inf
    hill = World(surfaces.ramp(inclination_deg=30, uphill_deg=90))
    assert hill.height_at(7.0, 1.0) == pytest.approx(math.tan(math.radians(30)))
    down, normal = hill.surface_at(0.0, -2.0)
    assert down == pytest.approx(2 * math.tan(math.radians(30)))
    assert math.degrees(math.acos(-normal[2])) == pytest.approx(30)


def test_every_kind_is_built_from_its_description() -> None:
    for kind in surfaces.SURFACES:
        needed = {
            "ramp": {"inclination_deg": 10.0},
            "box": {"north": 0.0, "east": 0.0, "length": 1.0, "width": 1.0, "top": 1.0},
            "step": {"height": 0.2},
            "strip": {"profile": [(0.0, 0.0), (1.0, 0.5)]},
        }.get(kind, {})
        assert build_world([{"kind": kind, **needed}]).facets


@pytest.mark.parametrize(
    ("description", "message"),
    [
        ({"kind": "lake"}, "kind must be one of"),
        ({"kind": "ramp"}, "inclination_deg"),
        ({"kind": "ramp", "inclination_deg": 95}, "between -89 and 89"),
        ({"kind": "stairs", "run": -1}, "run > 0"),
        ({"kind": "level", "material": "marble"}, "no material 'marble'"),
    ],
)
def test_a_wrong_description_is_refused(description: dict, message: str) -> None:
    with pytest.raises(DriverError, match=message):
        build_world([description])


@pytest.mark.parametrize("material", MATERIALS)
def test_textures_tile_without_a_seam_and_come_from_their_seed(material: str) -> None:
    picture = texture(material, 5, 256)
    assert np.array_equal(picture, texture.__wrapped__(material, 5, 256))
    assert not np.array_equal(picture, texture(material, 6, 256))
    inner = np.abs(np.diff(picture, axis=0)).mean(axis=1)
    seam = np.abs(picture[0] - picture[-1]).mean()
    assert seam <= inner.max() * 1.2
    for level in pyramid(picture)[1:4]:
        assert level.mean() == pytest.approx(picture.mean(), abs=0.5)


def test_a_pyramid_neither_moves_nor_folds_the_picture() -> None:
    n = 256
    x = np.arange(n) + 0.5
    wave = np.tile(np.cos(2 * np.pi * 8 * x / n), (n, 1)).astype(np.float32)
    levels = pyramid(wave)
    half = np.tile(np.cos(2 * np.pi * 8 * (np.arange(n // 2) + 0.5) / (n // 2)), (n // 2, 1))
    assert np.abs(levels[1] - half).max() < 0.03
    fast = np.tile(np.cos(2 * np.pi * 100 * x / n), (n, 1)).astype(np.float32)
    assert np.abs(pyramid(fast)[1]).max() < 0.03


@pytest.mark.parametrize("motion", ["x", "y", "z"])
def test_plane_sequences_carry_their_truth(motion: str) -> None:
    s = plane_sequence("noise", 30, axis="x", motion=motion, n=5, width=64, height=64, fine=False)
    assert s.images.shape == (5, 64, 64)
    assert s.slope_deg == pytest.approx((30, 0))
    # Distance along the axis to the plane, from the positions: the plane goes through NED's origin.
    east, down = s.positions[:, 1], s.positions[:, 2]
    assert s.distance == pytest.approx(s.a * east - down)
    if motion == "z":
        assert 1 / s.omega[:, 2] == pytest.approx(65.0 - np.arange(5))
        assert s.time_to_contact == pytest.approx(65.0 - np.arange(5))
    else:
        assert np.linalg.norm(s.omega, axis=1) == pytest.approx(0.011)


def test_the_frame_rate_is_measured(capsys: pytest.CaptureFixture[str]) -> None:
    facets, place = SCENES["stairs"]
    rate = frame_rate(Renderer(World(facets), Lens.from_fov(320, 240, 64)), np.array(place), DOWN, 0.3)
    print(f"320 x 240, stairs: {rate:.0f} frames/s")
    assert rate > 0
