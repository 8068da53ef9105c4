"""Pictures survive writing bit for bit, and failures leave the old file whole."""

import os
import resource
import signal
import subprocess
import sys

import numpy as np
import OpenEXR
import pytest

from whitted import files, image, tonemap
from whitted.errors import UsageError
from whitted.image import Picture

FACTS = {
    "samplesPerPixel": 64,
    "renderTimeSeconds": 1.5,
    "compileTimeSeconds": 0.25,
    "seed": 7,
    "integrator": "whitted",
    "variant": "llvm_ad_rgb",
    "effects": ["reflection", "soft_shadows"],
    "sceneHash": "9f86d081884c7d65",
    "mitsubaVersion": "3.9.1",
    "note": "ünïcode",
}


def make_picture(height=5, width=7, seed=0, **more):
    rng = np.random.default_rng(seed)
    channels = image.layer_channels("", rng.standard_normal((height, width, 4)))
    channels |= image.layer_channels("stderr", rng.random((height, width, 3)))
    for layer in ("spp", "lost", "share.soft_shadows"):
        channels |= image.layer_channels(layer, rng.random((height, width)))
    return Picture(channels, dict(FACTS), **more)


def same_bits(a, b):
    return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()


def test_exr_round_trip_is_exact(tmp_path):
    picture = make_picture()
    picture.channels["R"][0, :5] = [np.nan, np.inf, -np.inf, -0.0, 1e-42]
    image.write_exr(tmp_path / "a.exr", picture)
    back = image.read(tmp_path / "a.exr")
    assert set(back.channels) == set(picture.channels)
    assert {"R", "G", "B", "A", "stderr.R", "spp.Y", "lost.Y", "share.soft_shadows.Y"} <= set(back.channels)
    for name, plane in picture.channels.items():
        assert same_bits(back.channels[name], plane), name
    assert (back.width, back.height, back.offset, back.full_size) == (7, 5, (0, 0), (7, 5))
    assert os.listdir(tmp_path) == ["a.exr"]


def test_header_keeps_values_and_types(tmp_path):
    image.write_exr(tmp_path / "a.exr", make_picture())
    header = image.read(tmp_path / "a.exr").header
    for name, value in FACTS.items():
        assert header[name] == value, name
        assert type(header[name]) is type(value), name
    assert np.allclose(header["chromaticities"], image.REC709)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION
        assert {channel.type() for channel in file.channels().values()} == {OpenEXR.FLOAT}


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ({"seed": 2**40}, {"seed": 2**40}),
        ({"seed": np.int64(-3)}, {"seed": -3}),
        ({"renderTimeSeconds": np.float32(0.5)}, {"renderTimeSeconds": 0.5}),
        ({"effects": []}, {"effects": []}),
        ({"effects": ("gloss",)}, {"effects": ["gloss"]}),
        ({"partial": True}, {"partial": 1}),
        ({"note": None}, {}),
    ],
)
def test_header_types_that_openexr_lacks(tmp_path, given, read):
    image.write_exr(tmp_path / "a.exr", Picture({"Y": np.zeros((2, 2))}, given))
    header = image.read(tmp_path / "a.exr").header
    assert read.items() <= header.items()
    assert ("note" in header) == ("note" in read)


def test_header_refuses_other_types():
    with pytest.raises(TypeError, match="versions"):
        image.encode_exr(Picture({"Y": np.zeros((2, 2))}, {"versions": {"mitsuba": "3.9.1"}}))


def test_what_was_read_can_be_written(tmp_path):
    image.write_exr(tmp_path / "a.exr", make_picture(offset=(2, 3), full_size=(32, 16)))
    image.write_exr(tmp_path / "b.exr", image.read(tmp_path / "a.exr"))
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_crop_window(tmp_path):
    image.write_exr(tmp_path / "a.exr", make_picture(offset=(2, 3), full_size=(32, 16)))
    back = image.read(tmp_path / "a.exr")
    assert (back.width, back.height, back.offset, back.full_size) == (7, 5, (2, 3), (32, 16))
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        windows = {name: np.ravel(file.header()[name]).tolist() for name in ("dataWindow", "displayWindow")}
    assert windows == {"dataWindow": [2, 3, 8, 7], "displayWindow": [0, 0, 31, 15]}


def test_layers():
    picture = make_picture()
    assert same_bits(picture.rgb[..., 1], picture.channels["G"])
    assert same_bits(picture.stderr[..., 2], picture.channels["stderr.B"])
    mono = Picture(image.layer_channels("", np.arange(6.0).reshape(2, 3)))
    assert list(mono.channels) == ["Y"]
    assert mono.rgb.shape == (2, 3, 3)
    assert (mono.rgb == mono.channels["Y"][..., None]).all()
    assert mono.stderr is None


def test_mono_has_no_primaries(tmp_path):
    image.write_exr(tmp_path / "a.exr", Picture({"Y": np.ones((2, 2)), "stderr.Y": np.ones((2, 2))}))
    back = image.read(tmp_path / "a.exr")
    assert set(back.channels) == {"Y", "stderr.Y"}
    assert "chromaticities" not in back.header


def test_channels_of_different_sizes_are_refused():
    with pytest.raises(ValueError, match="sizes"):
        image.encode_exr(Picture({"Y": np.zeros((2, 2)), "spp.Y": np.zeros((2, 3))}))


@pytest.mark.parametrize("layout", ["half", "tiled", "parts"])
def test_other_programs_files(tmp_path, layout):
    values = (np.arange(12).reshape(3, 4) / 8).astype(np.float16 if layout == "half" else np.float32)
    channels = {"R": values, "G": values, "B": values, "id": np.full((3, 4), 9, np.uint32)}
    tiles = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()}
    header = tiles if layout == "tiled" else {"type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(header | {"name": "first"}, dict(channels))]
    if layout == "parts":
        parts.append(OpenEXR.Part({"name": "second"}, {"Z": np.zeros((3, 4), np.float32)}))
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    back = image.read(tmp_path / "a.exr")
    assert set(back.channels) == set(channels)
    for name, plane in channels.items():
        assert same_bits(back.channels[name], plane.astype(np.float32))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (None, "no such file or directory"),
        (b"", "not an OpenEXR file"),
        (b"\x89PNG\r\n", "not an OpenEXR file"),
        ("header", "truncated or damaged"),
        ("half", "truncated or damaged"),
        ("last byte", "truncated or damaged"),
        ("no colour", "there are: Z"),
    ],
)
def test_unreadable_files(tmp_path, capfd, content, complaint):
    path = tmp_path / "a.exr"
    whole = image.encode_exr(make_picture(70, 70))
    cuts = {"header": whole[:200], "half": whole[: len(whole) // 2], "last byte": whole[:-1]}
    if content == "no colour":
        path.write_bytes(image.encode_exr(Picture({"Z": np.zeros((2, 2))})))
    elif content is not None:
        path.write_bytes(cuts.get(content, content))
    with pytest.raises(UsageError, match=complaint) as caught:
        image.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_folder_is_no_picture(tmp_path):
    with pytest.raises(UsageError, match="is a directory"):
        image.read(tmp_path)


# Files


def test_write_replaces_and_keeps_permissions_and_links(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "real").chmod(0o640)
    (tmp_path / "link").symlink_to("real")
    files.write(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"
    assert (tmp_path / "real").stat().st_mode & 0o777 == 0o640


def test_write_goes_into_devices(tmp_path):
    files.check_writable(os.devnull)
    files.write(os.devnull, b"x")
    assert not os.path.isfile(os.devnull)
    read, write = os.pipe()
    files.write(f"/dev/fd/{write}", b"x")
    assert os.read(read, 2) == b"x"
    os.close(read)
    os.close(write)


@pytest.mark.parametrize("act", [files.check_writable, lambda path: files.write(path, b"x")])
@pytest.mark.parametrize(
    ("path", "complaint"),
    [
        ("no/such/a.exr", "the folder .*no/such does not exist"),
        ("", "it is a folder"),
        ("file/a.exr", "not a directory"),
        ("nul\0.exr", "null byte"),
        ("x" * 300, "file name too long"),
    ],
)
def test_unwritable_paths(tmp_path, act, path, complaint):
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=complaint) as caught:
        act(os.path.join(tmp_path, path))
    assert "\n" not in str(caught.value)
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize("act", [files.check_writable, lambda path: files.write(path, b"x")])
def test_permissions_are_respected(tmp_path, act):
    (tmp_path / "a").write_text("old")
    (tmp_path / "a").chmod(0o400)
    with pytest.raises(UsageError, match="read-only"):
        act(tmp_path / "a")
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="permission denied"):
        act(tmp_path / "b")
    tmp_path.chmod(0o700)


def test_check_writable_leaves_no_trace(tmp_path):
    files.check_writable(tmp_path / "a.exr")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch, error):
    (tmp_path / "a.exr").write_bytes(b"old")

    def fail(*_):
        raise error

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises((UsageError, KeyboardInterrupt)):
        image.write_exr(tmp_path / "a.exr", make_picture())
    assert (tmp_path / "a.exr").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.exr"]


def test_a_killed_writer_leaves_the_old_file(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(bytes(2_000_000))
    program = (
        "import sys; from whitted import files\n"
        "print(flush=True)\n"
        "while True:\n"
        "    for value in (0, 1): files.write(sys.argv[1], bytes([value]) * 2_000_000)\n"
    )
    writer = subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE)
    with writer:
        writer.stdout.readline()
        for _ in range(50):
            assert set(path.read_bytes()) in ({0}, {1})
        writer.send_signal(signal.SIGKILL)
    data = path.read_bytes()
    assert len(data) == 2_000_000
    assert len(set(data)) == 1


def test_full_device():
    with pytest.raises(UsageError, match="cannot write /dev/full: no space left on device"):
        image.write_exr("/dev/full", make_picture())


@pytest.mark.parametrize("limit", [0, 1, 4096, -1])
def test_full_disk_leaves_the_old_file(tmp_path, limit):
    """A limit on the size of files cuts a write short as a full disk does; -1 is one byte too few."""
    picture = make_picture(80, 80)
    size = len(image.encode_exr(picture))
    (tmp_path / "a.exr").write_bytes(b"old")
    old_limits, old_action = resource.getrlimit(resource.RLIMIT_FSIZE), signal.getsignal(signal.SIGXFSZ)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit % size, old_limits[1]))
    try:
        with pytest.raises(UsageError, match=r"cannot write .*a\.exr: file too large"):
            image.write_exr(tmp_path / "a.exr", picture)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old_limits)
        signal.signal(signal.SIGXFSZ, old_action)
    assert (tmp_path / "a.exr").read_bytes() == b"old"
    assert os.listdir(tmp_path) == ["a.exr"]


# Moments


def test_moments_round_trip(tmp_path):
    arrays = {
        "sums": np.random.default_rng(1).standard_normal((3, 4, 5, 3)),
        "weights": np.ones((4, 5), np.float32),
        "rays": np.array([2**40, 3], np.uint64),
        "file": np.array(np.nan),
    }
    meta = {"seed": 2**70, "scene": "ünï", "replicates": 3, "effects": [], "nested": {"a": None}}
    image.write_moments(tmp_path / "a.moments.npz", arrays, meta)
    back, facts = image.read_moments(tmp_path / "a.moments.npz")
    assert facts == meta
    assert set(back) == set(arrays)
    assert all(same_bits(back[name], arrays[name]) for name in arrays)


@pytest.mark.parametrize(
    "damage", ["missing", "empty", "text", "half", "flip", "other npz", "pickle", "version"]
)
def test_damaged_moments(tmp_path, monkeypatch, damage):
    path = tmp_path / "a.moments.npz"
    if damage == "version":
        monkeypatch.setattr(image, "MOMENTS_FORMAT", 99)
    image.write_moments(path, {"sums": np.arange(1000.0)}, {})
    monkeypatch.undo()
    whole = path.read_bytes()
    middle = len(whole) // 2
    if damage == "missing":
        path.unlink()
    elif damage == "other npz":
        np.savez(path, a=np.zeros(3))
    elif damage == "pickle":
        np.savez(path, json=np.array({"format": 1}, object))
    elif damage != "version":
        content = {"empty": b"", "text": b"hello", "half": whole[:middle]}
        flipped = whole[:middle] + b"\xff" + whole[middle + 1 :]
        path.write_bytes(content.get(damage, flipped))
    with pytest.raises(UsageError, match="cannot read"):
        image.read_moments(path)


def test_moments_take_no_objects(tmp_path):
    with pytest.raises(TypeError):
        image.write_moments(tmp_path / "a.npz", {"a": np.array([{}])}, {})


# Tone mapping


@pytest.mark.parametrize(
    ("linear", "shown"),
    [
        (0, 0),
        (0.0031308, 10),
        (0.18, 118),
        (0.5, 188),
        (1, 255),
        (2, 255),
        (-1, 0),
        (np.nan, 0),
        (np.inf, 255),
        (-np.inf, 0),
    ],
)
def test_tone_map_at_known_points(linear, shown):
    assert (tonemap.tone_map(np.full((1, 2, 3), linear)) == shown).all()


def test_exposure_counts_stops():
    rgb = np.random.default_rng(0).random((4, 4, 3))
    assert (tonemap.tone_map(rgb, exposure=2) == tonemap.tone_map(4 * rgb)).all()


def test_primaries():
    rec2020 = (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, 0.3127, 0.3290)
    colours = np.array([[[1, 1, 1], [0.18, 0.18, 0.18], [1, 0, 0], [0.5, 0.3, 0.2]]])
    shown = tonemap.tone_map(colours, chromaticities=rec2020)
    assert (shown[0, :2] == [[255] * 3, [118] * 3]).all()  # the same white
    assert shown[0, 2].tolist() == [255, 0, 0]  # out of gamut
    # ITU-R BT.2407, Annex 1: R = 1.6605 R' - 0.5876 G' - 0.0728 B', ...
    expected = np.array([[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]])
    direct = tonemap.tone_map((expected @ colours[0, 3])[None, None])
    assert np.abs(shown[0, 3].astype(int) - direct[0, 0]).max() <= 1
    assert (tonemap.tone_map(colours, chromaticities=image.REC709) == tonemap.tone_map(colours)).all()


def test_png(tmp_path):
    import mitsuba as mi

    rgb = np.random.default_rng(0).random((5, 7, 3)) * 1.2
    tonemap.write_png(tmp_path / "a.png", rgb, exposure=0.5)
    bitmap = mi.Bitmap(str(tmp_path / "a.png"))
    assert bitmap.component_format() == mi.Struct.Type.UInt8
    assert (np.array(bitmap) == tonemap.tone_map(rgb, 0.5)).all()
    assert os.listdir(tmp_path) == ["a.png"]


def test_panel():
    images = [np.full((2, 3, 3), value) for value in (0.1, 0.2, 0.3)]
    row = tonemap.panel(images, gutter=1)
    assert row.shape == (2, 11, 3)
    assert row[0, :, 0].tolist() == pytest.approx([0.1] * 3 + [1] + [0.2] * 3 + [1] + [0.3] * 3)
    grid = tonemap.panel(images, columns=2, gutter=1, background=0)
    assert grid.shape == (5, 7, 3)
    assert (grid[3:, :3] == np.float32(0.3)).all()
    assert (grid[2] == 0).all()
    assert (grid[3:, 4:] == 0).all()
    assert tonemap.panel(images[:1], columns=5).shape == (2, 3, 3)
    with pytest.raises(ValueError, match="one size"):
        tonemap.panel([*images, np.zeros((3, 2, 3))])
    with pytest.raises(ValueError, match="one size"):
        tonemap.panel([])


def test_difference():
    a, b = np.zeros((1, 5, 3)), np.zeros((1, 5, 3))
    a[0, :, :] = np.array([0, 1, 0, 0.5, np.nan])[:, None]
    b[0, 2] = 1
    shown = tonemap.difference(a, b, scale=1)
    assert shown[0].round(6).tolist() == [[1, 1, 1], [1, 0, 0], [0, 0, 1], [1, 0.5, 0.5], [0, 0, 0]]
    assert (tonemap.difference(b, b) == 1).all()
    assert tonemap.difference(a, b)[0, 1].tolist() == pytest.approx([1, 0, 0])


def test_start_up_imports_neither_colour_nor_openexr():
    program = "import sys, whitted.image, whitted.tonemap; print({'colour', 'OpenEXR'} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "set()"


def test_colour_is_silent(tmp_path):
    program = "import numpy; from whitted import tonemap; tonemap.tone_map(numpy.ones((1, 1, 3)))"
    blocked = "import sys; sys.modules['scipy'] = sys.modules['matplotlib'] = None; " + program
    result = subprocess.run([sys.executable, "-c", blocked], capture_output=True, text=True, check=True)
    assert result.stdout + result.stderr == ""
