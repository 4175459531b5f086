"""Rooms of others read no file outside their folder, and a small one does not exhaust the machine."""

import os
import struct
import time

import pytest

from dmae.data.resources import resource_folder
from synth.rooms.room import compile_mjcf, read_mjcf

BOX = '<geom type="box" size=".1 .1 .1"/>'
CUBE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def room(inside: str, asset: str = "") -> str:
    return f"<mujoco>{asset}<worldbody>{BOX}{inside}</worldbody></mujoco>"


@pytest.fixture
def folder(tmp_path):
    """A room's folder, next to a folder with files that are not its own."""
    (tmp_path / "room/meshes").mkdir(parents=True)
    (tmp_path / "private").mkdir()
    (tmp_path / "private/secret.xml").write_text("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    (tmp_path / "private/secret.obj").write_text(CUBE)
    (tmp_path / "room/meshes/cube.obj").write_text(CUBE)
    (tmp_path / "room/table.xml").write_text(f"<mujoco><worldbody><body>{BOX}</body></worldbody></mujoco>")
    return tmp_path / "room"


def write(folder, text: str):
    path = folder / "room.xml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", sorted(resource_folder("synth", "scenes").rglob("*.xml")), ids=lambda path: path.stem)
def test_rooms_and_props_that_are_shipped_are_read(path):
    assert compile_mjcf(path).ngeom


def test_files_in_the_folder_are_read(folder):
    asset = '<compiler meshdir="meshes"/><asset><mesh name="cube" file="cube.obj"/></asset>'
    text = f'<mujoco><include file="table.xml"/>{asset}<worldbody><geom type="mesh" mesh="cube"/></worldbody></mujoco>'
    assert compile_mjcf(write(folder, text)).ngeom == 2


@pytest.mark.parametrize(
    "name", ["../private/secret.xml", "PRIVATE/secret.xml", "meshes/../../private/secret.xml", "link.xml"]
)
def test_includes_stay_in_the_folder(folder, name):
    private = folder.parent / "private"
    (folder / "link.xml").symlink_to(private / "secret.xml")
    path = write(folder, room("", f'<include file="{name.replace("PRIVATE", str(private))}"/>'))
    with pytest.raises(ValueError, match=r"room\.xml: <include> names .*(secret|link)\.xml"):
        read_mjcf(path)
    (folder / "table.xml").write_text(f'<mujoco><include file="{name.replace("PRIVATE", str(private))}"/></mujoco>')
    with pytest.raises(ValueError, match=r"table\.xml: <include> names .*(secret|link)\.xml"):
        read_mjcf(write(folder, room("", '<include file="table.xml"/>')))


@pytest.mark.parametrize(
    "asset",
    [
        '<asset><mesh name="m" file="../private/secret.obj"/></asset>',
        '<asset><mesh name="m" file="PRIVATE/secret.obj"/></asset>',
        '<asset><mesh name="m" file="link.obj"/></asset>',
        '<compiler meshdir="../private"/><asset><mesh name="m" file="secret.obj"/></asset>',
        '<compiler meshdir="PRIVATE"/><asset><mesh name="m" file="secret.obj"/></asset>',
        '<compiler assetdir="../private"/><asset><mesh name="m" file="secret.obj"/></asset>',
        '<asset><texture name="t" type="2d" file="../private/secret.png"/></asset>',
        '<asset><texture name="t" type="cube" fileright="../private/secret.png"/></asset>',
        '<asset><hfield name="h" file="../private/secret.png" size="1 1 1 1"/></asset>',
        '<asset><skin name="s" file="../private/secret.skn"/></asset>',
        '<asset><mesh name="m" file="&#46;&#46;/private/secret.obj"/></asset>',
    ],
)
def test_meshes_and_images_stay_in_the_folder(folder, asset):
    private = folder.parent / "private"
    (folder / "link.obj").symlink_to(private / "secret.obj")
    path = write(folder, room("", asset.replace("PRIVATE", str(private))))
    with pytest.raises(ValueError, match=r"room\.xml: <\w+> names .*(private|link)"):
        read_mjcf(path)


REPEATED = "".join(['<replicate count="100" offset="1 0 0">'] * 4) + BOX + "</replicate>" * 4
HARMFUL = {
    "replicate": room(REPEATED),
    "include in replicate": room('<replicate count="9000"><include file="table.xml"/></replicate>'),
    "depth": room("<body>" * 400 + "</body>" * 400),
    "many elements": room(BOX * 20_000),
    "itself": room("", '<include file="room.xml"/>'),
    "texture": room("", '<asset><texture name="t" builtin="flat" type="cube" width="100000" height="600000"/></asset>'),
    "cube": room("", '<asset><texture name="t" builtin="flat" type="cube" width="20000"/></asset>'),
    "height field": room("", '<asset><hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/></asset>'),
    "memory": room("", '<size memory="900G"/>'),
    "user data": room("", '<size nuser_geom="1000000000"/>'),
    "numeric": room("", '<custom><numeric name="n" size="2000000000" data="1"/></custom>'),
    "sphere": room("", '<asset><mesh name="m" builtin="supersphere" params="100000 1 1"/></asset>'),
    "sensor": "<mujoco><worldbody/><sensor><user dim='2000000000'/></sensor></mujoco>",
    "image": room("", '<asset><texture name="t" type="2d" file="large.png"/></asset>'),
    "pipe": room("", '<asset><mesh name="m" file="pipe.obj"/></asset>'),
    "not a number": room('<geom type="box" size="nan 1 1"/>'),
    "infinite": room('<geom type="box" size="1 1 1" pos="inf 0 0"/>'),
    "huge": room('<geom type="box" size="1e300 1 1"/>'),
    "entities": '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><mujoco><worldbody/></mujoco>',
    "plugin": "<mujoco><extension><plugin plugin='x'/></extension><worldbody/></mujoco>",
    "robot": "<robot name='x'><link name='y'/></robot>",
    "other encoding": '<?xml version="1.0" encoding="utf-7"?><mujoco><worldbody>\xff',
    "cut short": room("")[:40],
    "no text": "\x00\x01",
    "compile error": room('<geom type="mesh" mesh="none"/>'),
}  # fmt: skip


@pytest.mark.parametrize("name", HARMFUL)
def test_a_small_file_does_not_exhaust_the_machine(folder, name):
    (folder / "large.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + struct.pack(">II", 60_000, 60_000) + bytes(9))
    os.mkfifo(folder / "pipe.obj")
    path = write(folder, HARMFUL[name])
    started = time.process_time()
    with pytest.raises(ValueError, match=r"room\.xml|large\.png|pipe\.obj"):
        compile_mjcf(path)
    assert time.process_time() - started < 2
