"""A simulated clip records where it was made, and so its room can be drawn without images."""

from dmae.viewing.config import LayersConfig
from dmae.viewing.overlay import Overlay, chosen_layers
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.rendering.rooms import draw_rooms
from synth.scene.config import SceneConfig


def test_the_room_is_drawn_from_the_clip_s_provenance():
    config = GenerateConfig(seed=1, clips=1, scene=SceneConfig(arena="office", persons=[1, 1], seconds=0.1))
    clip = generate_clip(config, 0)
    rooms = draw_rooms(clip)
    assert [room.shape[:2] for room in rooms] == [tuple(size[::-1]) for size in clip.rig.size.tolist()]
    assert all(room.std() > 5 for room in rooms)
    layers, nothing = chosen_layers(clip, LayersConfig()), [None] * len(clip.rig)
    tile, empty = (Overlay(clip, 480, layers, shown).tiles(0, nothing)[0] for shown in (rooms, None))
    assert (tile != empty).any(-1).mean() > 0.5
