"""Light and camera of colour images, against formulas; labels and other images do not depend on them."""

import re

import mujoco
import numpy as np
import pytest

from dmae.data.cameras import CameraRig
from dmae.formats.rig import intrinsics
from synth.rendering.config import ImageQuality, ImagingConfig
from synth.rendering.renderer import Renderer
from synth.rendering.sensor import Sensor, decode
from synth.rigs.lenses import add_cameras
from synth.rigs.placement import aimed
from tests.support.standing_people import looking_along_x, scene

FAULTLESS = {"exposure": 0, "white_balance": 0, "electrons": 0, "read_noise": 0}
PLAIN = ImagingConfig(lamp=0, ambient_occlusion=0, **FAULTLESS)
SIZE = [640, 480]
LENS = intrinsics(500, SIZE)


def grey(level: int, side: int = 400) -> np.ndarray:
    return np.full((side, side, 3), level, np.uint8)


# The sensor


def test_without_faults_every_value_stays_as_it_is():
    values = np.arange(256, dtype=np.uint8)[:, None, None].repeat(3, 2)
    np.testing.assert_array_equal(Sensor(PLAIN, 0, 0, 0).image(values, 0), values)


@pytest.mark.parametrize("read_noise", [0, 15])
def test_the_variance_of_light_is_linear_in_light(read_noise):
    config = ImagingConfig(exposure=0, white_balance=0, electrons=400, read_noise=read_noise)
    levels = [110, 140, 170, 200]
    images = [decode(Sensor(config, 3, 1, 0).image(grey(level), 5)) for level in levels]
    signal = decode(np.array(levels))
    np.testing.assert_allclose([image.mean() for image in images], signal, rtol=0.01)
    expected = signal / 400 + (read_noise / 400) ** 2
    np.testing.assert_allclose([image.var() for image in images], expected, rtol=0.03)


def test_noise_is_independent_between_pixels_channels_and_frames():
    sensor = Sensor(ImagingConfig(exposure=0, white_balance=0, electrons=500), 0, 0, 0)
    one, two = (decode(sensor.image(grey(150), frame)) - 0.3 for frame in (0, 1))
    pairs = [(one[1:], one[:-1]), (one[:, 1:], one[:, :-1]), (one[..., 0], one[..., 1]), (one, two)]
    for a, b in pairs:
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.02


def test_exposure_and_white_balance_are_gains_of_light_that_differ_from_camera_to_camera():
    config = ImagingConfig(exposure=0.4, white_balance=0.2, electrons=0)
    sensors = [Sensor(config, 7, 2, view) for view in range(300)]
    for sensor in sensors[:3]:
        light = decode(sensor.image(grey(120, 2), 0))[0, 0]
        np.testing.assert_allclose(light / decode(np.array(120)), sensor.gains, rtol=0.02)
    stops = np.log2([sensor.gains for sensor in sensors])
    np.testing.assert_allclose(stops[:, 1].std(), 0.4, rtol=0.15)
    np.testing.assert_allclose((stops[:, 0] - stops[:, 1]).std(), 0.2, rtol=0.15)


def test_a_image_depends_on_seed_clip_camera_and_frame_alone():
    config = ImagingConfig()

    def image(seed, clip, view, frame):
        return Sensor(config, seed, clip, view).image(grey(100, 20), frame).tobytes()

    assert image(0, 1, 2, 3) == image(0, 1, 2, 3)
    others = [image(1, 1, 2, 3), image(0, 0, 2, 3), image(0, 1, 1, 3), image(0, 1, 2, 2)]
    assert len({image(0, 1, 2, 3), *others}) == 5


def test_jpeg_of_low_quality_leaves_the_edges_of_its_blocks():
    y, x = np.mgrid[:256, :256]
    smooth = (60 + 60 * np.sin(x / 23) * np.sin(y / 31))[..., None].repeat(3, 2).astype(np.uint8)
    stored = Sensor(ImagingConfig(jpeg=5, **FAULTLESS), 0, 0, 0).image(smooth, 0).astype(float)
    steps = np.abs(np.diff(stored[..., 1], axis=1)).mean(0)
    assert steps[7::8].mean() > 3 * np.delete(steps, np.s_[7::8]).mean()


@pytest.mark.parametrize("given", [{"lamp": -1}, {"electrons": np.nan}, {"shutter": np.inf}, {"jpeg": 101}])
def test_values_out_of_range_are_refused(given):
    ((name, value),) = given.items()
    with pytest.raises(ValueError, match=re.escape(f"imaging.{name}: expected") + ".*" + re.escape(f"found {value}")):
        ImagingConfig(**given)


# Motion blur


@pytest.mark.gl
def test_a_moving_edge_is_blurred_over_speed_times_shutter_around_its_place(gl):
    speed, fps, shutter = 6.0, 25, 0.02
    rig = looking_along_x((-4, 0, 1))
    spec = mujoco.MjSpec.from_string(
        '<mujoco><visual><headlight active="0"/></visual><asset><material name="shine" emission="1"/></asset>'
        '<worldbody><body pos="0 1 1"><joint type="slide" axis="0 1 0"/>'
        '<geom type="box" size=".01 1 .5" material="shine"/></body></worldbody></mujoco>'
    )
    add_cameras(spec, rig)
    model = spec.compile()
    qpos = speed / fps * np.array([[-1.0], [0.0], [1.0]])
    profiles = []
    for config in (PLAIN, ImagingConfig(lamp=0, ambient_occlusion=0, shutter=shutter)):
        with Renderer(model, np.array([256], np.uint16), rig, ImageQuality.draft, config) as renderer:
            motion = renderer.motion(qpos, 1, fps)
            image = renderer.image(qpos[1], 0, ("rgb", "ids"), None, motion)
        profiles.append(decode(image.rgb)[240, :, 0])
        assert (image.ids[240] == 256).sum() == profiles[0].round().sum()
    sharp, blurred = profiles
    # The right edge of the box, at y = 0, is in the middle of the image.
    edge = slice(270, 370)
    spread = -np.diff(blurred[edge])
    place = (np.arange(len(spread)) * spread).sum()
    width = np.sqrt(12 * ((np.arange(len(spread)) - place) ** 2 * spread).sum())
    length = speed * shutter * 500 / 4
    assert abs(width - length) < 1
    assert abs(place - (-np.diff(sharp[edge]) * np.arange(len(spread))).sum()) < 0.6
    np.testing.assert_allclose(blurred[edge].sum(), sharp[edge].sum(), atol=0.6)


# Light


def from_above(height: float, x: float) -> CameraRig:
    """A camera that looks straight down; the world's x is to the right."""
    return aimed(["c"], LENS, np.array([(x, 0, height)]), np.array((x, 0, 0)), SIZE)


def aslant(away: float) -> CameraRig:
    """A camera that looks 45 degrees down and along -x at the origin, from a distance."""
    return aimed(["c"], LENS, np.sqrt(0.5) * np.array([(away, 0, away)]), np.zeros(3), SIZE)


def painted(xml: str, rig: CameraRig, config: ImagingConfig) -> np.ndarray:
    spec = mujoco.MjSpec.from_string(xml)
    add_cameras(spec, rig)
    model = spec.compile()
    with Renderer(model, np.zeros(model.ngeom, np.uint16), rig, ImageQuality.standard, config) as renderer:
        return renderer.image(model.qpos0, 0, ("rgb",)).rgb[..., 0].astype(float)


@pytest.mark.gl
@pytest.mark.parametrize("radius", [0.1, 0.3])
def test_a_penumbra_shows_the_visible_part_of_a_round_lamp(gl, radius):
    lamp, plate, edge = 4.0, 1.2, 0.5
    rig = from_above(4.0, 2.5)
    xml = (
        '<mujoco><visual><headlight active="0"/></visual><worldbody><light type="spot" pos="0 0 4" dir="0 0 -1" '
        'cutoff="80" exponent="0" diffuse=".8 .8 .8" ambient="0 0 0" specular="0 0 0" castshadow="true"/>'
        '<geom type="plane" size="9 9 .1" rgba="1 1 1 1"/>{}</worldbody></mujoco>'
    )
    config = ImagingConfig(lamp=radius, ambient_occlusion=0)
    # The plate is thin: light enters past its upper edge.
    shadowed = painted(xml.format(f'<geom type="box" pos="{edge - 1} 0 {plate}" size="1 3 .001"/>'), rig, config)
    shares = shadowed / painted(xml.format(""), rig, config)
    share = shares[240]
    x = 2.5 + (np.arange(640) - 319.5) * 4 / 500
    on_floor = x > 0.3
    far = np.clip((x + (edge - x) * lamp / plate) / radius, -1, 1)
    expected = (np.arccos(far) - far * np.sqrt(1 - far**2)) / np.pi
    assert np.abs(share - expected)[on_floor & (np.abs(far) < 1)].mean() < 0.06
    assert np.abs(share - expected)[on_floor & (np.abs(far) == 1)].max() < 0.12
    # Along the edge of the plate the light is even: no screen of dots, at the foot of the penumbra either.
    assert shares[200:280].std(0)[on_floor].max() < 0.004


@pytest.mark.gl
@pytest.mark.parametrize("lit", [True, False])
def test_a_point_lamp_casts_sharp_shadows_and_no_ambient_occlusion_takes_its_light(gl, lit):
    wall, edge, ambient, direct = 0.5, 0.05, 0.3, 0.5
    xml = (
        f'<mujoco><visual><headlight ambient="{ambient} {ambient} {ambient}" diffuse="0 0 0" specular="0 0 0"/>'
        f'</visual><worldbody><light type="directional" dir="{-0.7 if lit else 0.7} 0 -1" castshadow="true" '
        f'diffuse="{direct} {direct} {direct}" ambient="0 0 0" specular="0 0 0"/>'
        '<geom type="plane" size="9 9 .1" rgba="1 1 1 1"/>'
        f'<geom type="box" pos="-.01 0 {wall / 2}" size=".01 3 {wall / 2}" rgba="1 1 1 1"/></worldbody></mujoco>'
    )
    rig = aslant(2.0)
    ray = rig.rays(np.stack([np.full(480, 319.5), np.arange(480.0)], -1)[None, None])[0, 0]
    x = rig.centers[0, 0] - ray[:, 0] / ray[:, 2] * rig.centers[0, 2]
    bare, dark, soft = (
        painted(xml, rig, ImagingConfig(lamp=lamp, ambient_occlusion=reach))[:, 310:330].mean(1) / 255
        for lamp, reach in ((0, 0), (0, 0.5), (0.2, 0.5))
    )
    far = 0.0 if lit else 0.7 * wall
    inside, beyond = (x > 0.02) & (x < far - edge), x > far + edge
    np.testing.assert_allclose(bare[inside], ambient, atol=0.01)
    np.testing.assert_allclose(bare[beyond], ambient + direct / np.sqrt(1 + 0.7**2), atol=0.01)
    # Ambient occlusion takes a share of the ambient light alone, at most a half of it at the foot of a wall.
    foot = (x > 0.05) & (x < 0.1)
    assert 0.1 * ambient < (bare - dark)[foot].max() < 0.5 * ambient
    if lit:
        np.testing.assert_allclose(dark[beyond], soft[beyond], atol=0.01)


@pytest.mark.gl
def test_ambient_light_at_the_foot_of_a_wall_is_that_of_the_open_part_of_the_sky(gl):
    radius = 0.5
    rig = aslant(2.0)
    xml = (
        '<mujoco><visual><headlight ambient=".8 .8 .8" diffuse="0 0 0" specular="0 0 0"/></visual><worldbody>'
        '<geom type="plane" size="9 9 .1" rgba="1 1 1 1"/><geom type="box" pos="-.5 0 .5" size=".5 3 .5"/>'
        "</worldbody></mujoco>"
    )
    open_sky = painted(xml, rig, ImagingConfig(lamp=0, ambient_occlusion=radius))[:, 310:330].mean(1) / (0.8 * 255)
    ray = rig.rays(np.stack([np.full(480, 319.5), np.arange(480.0)], -1)[None, None])[0, 0]
    x = rig.centers[0, 0] - ray[:, 0] / ray[:, 2] * rig.centers[0, 2]
    angle = np.linspace(-np.pi / 2, np.pi / 2, 501)[1:-1]
    # The highest horizon of a high wall at a distance d, with the range r, has sin(a)^2 = (1 - d/r)^2.
    near = np.clip(1 - x[:, None] / (radius * np.cos(angle)), 0, 1)
    expected = 1 - (near**2).mean(1) / 2
    # Directions are even in the image, not around the normal: near the wall, less light is lost than should be.
    assert np.abs(open_sky - expected)[x > 0.02].max() < 0.2
    assert np.abs(open_sky - expected)[x > 0.1].max() < 0.12
    assert np.abs(open_sky - expected)[x > radius].max() < 0.01


def test_ids_and_depth_do_not_depend_on_light_and_camera(painter):
    rig = looking_along_x((-4, 0, 1))
    model, ids, _ = scene(rig, [(0, 0), (1, 0.5)], '<geom name="box" type="box" size=".2 .2 .4" pos="-1 -.4 .4"/>')
    found = []
    for config in (PLAIN, ImagingConfig(shutter=0.02, jpeg=50)):
        with Renderer(model, ids, rig, ImageQuality.standard, config) as renderer:
            kinds = ("rgb", "depth", "ids", "normals", "amodal")
            motion = None if config is PLAIN else 0.05 * np.ones(model.nv)
            found.append(renderer.image(model.qpos0, 0, kinds, None, motion))
    for kind in ("depth", "ids", "normals", "amodal"):
        np.testing.assert_array_equal(getattr(found[0], kind), getattr(found[1], kind))
    assert (found[0].rgb != found[1].rgb).any()
