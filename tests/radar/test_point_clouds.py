"""Point-cloud logs of TI demos, written here."""

import json

import numpy as np
import pytest

from command import run
from doppelgait.core.errors import RecordingError
from doppelgait.radar.point_clouds import collect_tracks, interpolate_ranges, read_points, tabulate_tracks
from doppelgait.testing.tracking import compare_tracks

FRAME_S = 0.05


def bodies():
    """Times of 4 s and the places of two bodies: one comes along y at 1 m/s, one goes away at 0.8 m/s."""
    times_s = FRAME_S * np.arange(80)
    one = np.stack([np.full(80, 0.5), 6.0 - 1.0 * times_s], axis=1)
    other = np.stack([np.full(80, -1.0), 2.0 + 0.8 * times_s], axis=1)
    return times_s, (one, other)


def lines():
    """Seven points a body and frame: the torso five times, a limb on either side; some of no track."""
    rng = np.random.default_rng(1)
    times_s, places = bodies()
    for n, time_s in enumerate(times_s):
        for track, place_m in enumerate(places):
            step = np.gradient(place_m, FRAME_S, axis=0)[n]
            away = float(step @ place_m[n] / np.linalg.norm(place_m[n]))  # TI: positive when it goes away
            for extra in (0, 0, 0, 0, 0, -0.6, 0.6):
                x, y = place_m[n] + 0.01 * rng.normal(size=2)
                yield n, time_s, x, y, 0.0, away + extra, 20.0, track + 3
        yield n, time_s, 9.0, 9.0, 0.0, 3.0, 5.0, 255


def write_csv(path, header="frame,time,x,y,z,doppler,snr,track", keep=range(8)):
    rows = [",".join(f"{row[k]:.6g}" for k in keep) for row in lines()]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def write_json(path, *, late):
    """As the visualizer: in the point itself, or the tracks of a frame's points with the frame after."""
    frames = {}
    for n, time_s, x, y, z, doppler, snr, track in lines():
        frame = frames.setdefault(n, {"timestamp": 1.7e12 + 1e3 * time_s, "frameData": {"pointCloud": []}})
        frame["frameData"]["pointCloud"].append([x, y, z, doppler, snr, 1.0, 255 if late else track])
        frame.setdefault("own", []).append(track)
    data = list(frames.values())
    own = [frame.pop("own") for frame in data]
    if late:
        for frame, before in zip(data[1:], own[:-1], strict=True):
            frame["frameData"]["trackIndexes"] = before
    path.write_text(json.dumps({"cfg": [], "demo": "3D People Tracking", "data": data}))
    return path


@pytest.mark.parametrize("form", ["csv", "frames", "json", "late"])
def test_tracks_and_their_speeds(tmp_path, form):
    if form == "csv":
        points = read_points(write_csv(tmp_path / "a.csv"))
    elif form == "frames":
        path = write_csv(tmp_path / "a.csv", "FrameNum,posX,posY,v,Track_ID", (0, 2, 3, 5, 7))
        points = read_points(path, frame_period_s=FRAME_S)
    else:
        points = read_points(write_json(tmp_path / "a.json", late=form == "late"))
    assert len(points) == 80 * 15
    tracks = collect_tracks(points)
    assert [one.track for one in tracks] == [3, 4]
    table = tabulate_tracks(tracks)
    # radial velocity of the closed form: the median over the frames
    times_s, places = bodies()
    radial = [-np.gradient(np.linalg.norm(place, axis=1), FRAME_S) for place in places]
    assert table["torso_velocity_mps"].to_numpy() == pytest.approx([np.median(v) for v in radial], abs=0.01)
    assert table["range_rate_mps"].to_numpy() == pytest.approx([np.mean(v) for v in radial], abs=0.02)
    assert table["ground_speed_mps"].to_numpy() == pytest.approx([1.0, 0.8], abs=0.01)
    assert table["velocity_spread_mps"].to_numpy() == pytest.approx([1.2, 1.2], abs=0.01)
    assert table["range_start_m"].to_numpy() == pytest.approx([np.hypot(0.5, 6), np.hypot(1, 2)], abs=0.03)
    truth = np.stack([np.linalg.norm(place, axis=1) for place in places], axis=1)
    score = compare_tracks(interpolate_ranges(tracks, times_s), truth)
    assert score.completeness.min() > 0.95
    assert score.switches == 0
    assert score.rms < 0.02
    assert np.isnan(interpolate_ranges(tracks, [-1.0, 5.0])).all()


def test_gaps_turns_and_signs(tmp_path):
    path = write_csv(tmp_path / "a.csv")
    flipped = tabulate_tracks(collect_tracks(read_points(path, approaching_positive=True)))
    plain = tabulate_tracks(collect_tracks(read_points(path)))
    assert flipped["torso_velocity_mps"].to_numpy() == pytest.approx(-plain["torso_velocity_mps"].to_numpy())
    with pytest.raises(RecordingError, match="frame_period_s = -1"):
        read_points(path, frame_period_s=-1)
    points = read_points(path)
    broken = collect_tracks(points[(points["time_s"] < 1) | (points["time_s"] > 1.9)])
    found = interpolate_ranges(broken, [0.5, 1.5, 3.0])
    assert np.isnan(found[1]).all()
    assert np.isfinite(found[[0, 2]]).all()
    again = collect_tracks(points[(points["time_s"] < 1) | (points["time_s"] > 2.2)])
    assert [one.track for one in again] == [3, 3, 4, 4]  # a number that returns later is another body's
    assert [one.times_s[-1] < 1 for one in again] == [True, False, True, False]
    assert collect_tracks(points[points["time_s"] < 4 * FRAME_S - 1e-9]) == []
    angle = 2 * np.pi * points["time_s"] / 4
    circle = points.assign(x_m=np.cos(angle), y_m=3 + np.sin(angle))
    assert tabulate_tracks(collect_tracks(circle))["ground_speed_mps"].isna().all()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "cannot be read as CSV"),
        ("a.csv", "x,y,doppler,track\n", "holds no points"),
        ("a.csv", "x,y,track\n1,2,3\n", "no column for doppler_mps; it has x, y, track. Known names of"),
        ("a.csv", "x,y,v,track\n1,2,3,4\n", "has no times; set frame_period_s"),
        ("a.csv", "time,x,y,v,track\n0,1,a,3,4\n", "line 2, y: 'a' is no number"),
        ("a.csv", "time,x,y,v,track\n1,1,1,1,4\n0,1,1,1,4\n", "point 2 is earlier"),
        ("a.json", "{", "the file is no JSON"),
        ("a.json", "[]", "the file is not as of the Industrial Visualizer"),
        ("a.json", '{"data": [{"frameData": {"pointCloud": [[1,2]]}, "timestamp": 1}]}', "frame 1 is no JSON of"),
        ("a.json", '{"data": [{"frameData": {"pointCloud": [[1,2,3,4,5,6,7]]}}]}', "frame 1 is not as of .*timestamp"),
        ("a.json", '{"data": [{"frameData": {"pointCloud": [[1,2,3,NaN,5,6,7]]}, "timestamp": 1}]}', "no doppler_mps"),
        ("b.json", None, "no such file"),
    ],
)
def test_files_that_are_wrong(tmp_path, name, text, message):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(RecordingError, match=message) as caught:
        read_points(tmp_path / name)
    assert str(tmp_path) in str(caught.value)


def test_the_command_prints_the_table(tmp_path):
    turns = "\n".join(f"{n / 20},{np.cos(n / 9):.4f},{3 + np.sin(n / 9):.4f},0.1,1" for n in range(60))
    (tmp_path / "turns.csv").write_text(f"time,x,y,v,track\n{turns}\n")
    rows = json.loads(run("radar", "points", tmp_path / "turns.csv", "--json").stdout)
    assert rows[0]["ground_speed_mps"] is None
    path = write_csv(tmp_path / "a.csv")
    rows = json.loads(run("radar", "points", path, "--json").stdout)
    assert [row["track"] for row in rows] == [3, 4]
    assert "torso_velocity_mps" in run("radar", "points", path).stdout
