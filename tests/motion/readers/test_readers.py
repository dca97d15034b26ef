"""What ``read`` does with a recording after its reader: segments and loops."""

import numpy as np
import pandas as pd
import pytest

from checkout import ROOT
from doppelgait.core.errors import DoppelgaitWarning, MotionError
from doppelgait.core.readers import list_options
from doppelgait.motion import boulic_walk, read
from doppelgait.motion.describe import describe_motion, describe_recording
from doppelgait.motion.readers import MOTION_READERS


def write_walk(path, walk, position_m):
    names = [f"{marker}_{axis}_m" for marker in walk.markers for axis in "xyz"]
    table = pd.DataFrame(position_m.reshape(len(position_m), -1), columns=names)
    table.insert(0, "time_s", np.arange(len(position_m)) / walk.rate_hz)
    table.to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def walk_then_stand(tmp_path_factory):
    """A marker table: 4 s of walking, 2 s of standing, another 3 s of walking."""
    walk = boulic_walk(speed_mps=1.3, height_m=1.75, duration_s=7.0, rate_hz=100.0)
    frames = np.concatenate([np.arange(400), np.full(200, 400), np.arange(400, 700)])
    return write_walk(tmp_path_factory.mktemp("motion") / "walk.csv", walk, walk.position_m[frames])


def test_a_segment_is_looped_over_whole_strides(walk_then_stand):
    looped = read(walk_then_stand, segment=2, loop_to_s=8.0)
    assert looped.time_s[-1] == pytest.approx(8.0, abs=0.02)
    assert looped.facts.stride_frequency_hz == pytest.approx(
        boulic_walk(speed_mps=1.3, height_m=1.75).facts.stride_frequency_hz, rel=0.01
    )
    centre = looped.position_m.mean(axis=1)[:, 0]
    assert (centre[-1] - centre[0]) / 8.0 == pytest.approx(1.3, rel=0.02)
    repeated = read(walk_then_stand, segment=2, loop_to_s=8.0, loop_variation=0.0)
    assert [motion.report["loop"]["stride_time_sd"] > 0 for motion in (repeated, looped)] == [False, True]
    assert np.abs(repeated.position_m - looped.position_m).max() > 0.01


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"segment": 3}, "segment = 3 is not allowed; allowed are 'longest' and 1 to 2"),
        ({"segment": "last"}, "segment = 'last' is not allowed"),
        ({"segment": True}, "segment = True is not allowed"),
        ({"segment": 1, "loop_to_s": -1.0}, "loop_to_s = -1.0 is not allowed"),
        ({"segment": 1, "clean": False}, "need a cleaned motion"),
        ({"start_s": 4.2, "stop_s": 5.8, "segment": 1}, "no straight segment at constant velocity"),
        ({"rate_hz": "abc"}, "rate_hz = 'abc' is not allowed; it must be a number"),
        ({"units": 5}, "units = 5 is not allowed; it must be a text"),
        ({"loop_to_s": 1e9}, "loop_to_s = 1000000000.0 is not allowed; it must be a number above 0 and at most 3600"),
        ({"loop_variation": -0.5}, "loop_variation = -0.5 is not allowed; it must be 0 to 2"),
        ({"clean": "no"}, "clean = 'no' is not allowed; it must be true or false"),
    ],
)
def test_a_wrong_choice_or_kind_is_one_clear_error(walk_then_stand, options, says):
    with pytest.raises(MotionError, match=says):
        read(walk_then_stand, **options)
    if "clean" not in options:
        with pytest.raises(MotionError, match=says):
            describe_recording(walk_then_stand, **options)


@pytest.mark.parametrize("options", [{}, {"start_s": 2.0}])
def test_a_segment_has_its_own_gait_and_its_place_in_the_file(walk_then_stand, options):
    """Times of a segment count from the first frame of the file, as ``start_s`` and ``stop_s`` do."""
    whole, segment = read(walk_then_stand), read(walk_then_stand, segment=2, **options)
    place_s = segment.facts.file_time_s
    assert 5.5 < place_s < 7.0
    assert segment.n_frames == pytest.approx(300, abs=30)
    k = round(place_s * 100.0)
    inside = slice(20, segment.n_frames - 20)
    middle = whole.positions.sel(marker=segment.markers).values[k : k + segment.n_frames]
    np.testing.assert_allclose(segment.position_m[inside], middle[inside], atol=0.02)
    assert all(0 <= t <= segment.time_s[-1] for times in segment.facts.footfalls.values() for t in times)
    (listed,) = describe_motion(segment)["segments"]
    assert place_s <= listed["start_s"] < listed["stop_s"] <= place_s + segment.duration_s
    first, second = describe_recording(walk_then_stand)["segments"]
    assert segment.facts.gait == first["gait"] == "walk"
    assert segment.facts.stride_frequency_hz == pytest.approx(second["stride_frequency_hz"], rel=0.02)
    longest = read(walk_then_stand, segment="longest")
    np.testing.assert_array_equal(longest.position_m, read(walk_then_stand, segment=1).position_m)
    looped = describe_recording(walk_then_stand, segment=1, loop_to_s=6.0)
    assert looped["cleaned"]["duration_s"] == pytest.approx(6.0, abs=0.02)


def table_of(path, factor, *, far=0, wide=0):
    """A walk whose coordinates are wrong by a factor, in some samples or in some frames."""
    walk = boulic_walk(speed_mps=1.3, height_m=1.75, duration_s=2.0, rate_hz=50.0)
    position = walk.position_m * factor
    position[:far, 0] = 5e3
    position[:wide, 0, 0] += 100.0
    return write_walk(path, walk, position)


@pytest.mark.parametrize(
    ("factor", "wide"),
    [(1e-9, 0), (0.02, 0), (10.0, 0), (25.0, 0), (1000.0, 0), (1.0, 12), (0.05, -1), (5.0, -1), (1.0, 9)],
)
def test_bodies_that_cannot_be_are_refused(tmp_path, factor, wide):
    """A point may be elsewhere in a tenth of the frames; the last rows are the smallest and the largest body."""
    path = table_of(tmp_path / "w.csv", factor, wide=max(wide, 0))
    if wide in (-1, 9):
        assert read(path, clean=False).n_frames == 101
        return
    with pytest.raises(MotionError, match=r"w\.csv: its points span .* m; allowed are 0\.05 to 15 m\. Is the unit"):
        read(path)


def test_single_positions_far_away_become_gaps(tmp_path):
    path = table_of(tmp_path / "w.csv", 1.0, far=3)
    with pytest.warns(DoppelgaitWarning, match="3 positions far from the origin or the others"):
        motion = read(path, clean=False)
    assert np.isnan(motion.position_m).any(axis=(1, 2)).nonzero()[0].tolist() == [0, 1, 2]
    with pytest.raises(MotionError, match=r"50 of 1,717 positions are up to 5e\+03 m from the origin"):
        read(table_of(tmp_path / "w.csv", 1.0, far=50))


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("walk.bin", b"Kaydara FBX Binary  \0", r"is an FBX animation.*export it as \.bvh or \.glb"),
        ("walk.BLEND", b"\x28\xb5\x2f\xfd", "is a Blender scene"),
        ("walk.gltf", b'{"asset": {"version": "2.0"}, "skins": [{"joints": [1]}]}', r"export it as one \.glb"),
        ("walk_keypoints.json", b'{"version": 1.3, "people": [{"pose_keypoints_2d": []}]}', "must be triangulated"),
        ("walk.c3d.gz", b"\x1f\x8b\x08\0", "is an archive.*unpack it"),
        ("smpl.pkl", b"\x80\x04\x95", "Python pickle"),
        ("walk.trb", b"\x01\x02\x03", "export the markers as TRC or C3D"),
        ("walk.xyz", b"\x01\x02\x03", r"known are: .*qualisys \(\.tsv\)"),
    ],
)
def test_a_file_of_another_kind_is_named_with_what_to_export(tmp_path, name, content, says):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(MotionError, match=says):
        read(tmp_path / name)


def test_every_format_is_a_row_of_the_page():
    page = (ROOT / "docs/motion.md").read_text()
    for reader in MOTION_READERS.values():
        suffixes = ", ".join(f"`{suffix}`" for suffix in reader.facts["suffixes"])
        (row,) = [line for line in page.split("\n") if line.startswith(f"| `{reader.name}` | {suffixes} |")]
        options = list_options(reader.run)
        assert all(f"`{name}`" in row or "as `c3d`" in row or "the same" in row for name in options), (row, options)
