"""Foreign recordings: what comes in is what was written, in SI; what is wrong is refused and leaves nothing behind."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner, Result
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from spsp_ctrl.cli import cli
from spsp_ctrl.config.import_map import Time
from spsp_ctrl.config.loader import load_import_map
from spsp_ctrl.plant.axis_controller import replay
from spsp_ctrl.plant.axis_model import AxisController
from spsp_ctrl.recording.importing import import_log
from spsp_ctrl.recording.importing_checks import judge_time
from spsp_ctrl.recording.reader import digest_topics, read_log

ROOT = Path(__file__).parents[2]
BENCH, EMPS = ROOT / "config/import/bench-csv.yaml", ROOT / "config/import/emps.yaml"
DATA = Path(os.environ.get("SPSP_CTRL_DATA", ROOT.parent / "shared" / "data")) / "emps" / "DATA_EMPS.mat"

Columns = dict[str, np.ndarray]


def bench(n: int = 600, rate: float = 100.0) -> Columns:
    """Six seconds of a bench, in the units and with the signs of ``bench-csv.yaml``."""
    t = np.arange(n) / rate
    w = np.pi
    x, v, a = 5 * np.sin(w * t), 5 * w * np.cos(w * t), -5 * w * w * np.sin(w * t)
    i = a / 480 + v / 720
    rng = np.random.default_rng(1)
    return {
        "time_ms": 1e3 * t,
        "demand_mm": x,
        "i_cmd": i,
        "i_meas_mA": 1e3 * i + rng.normal(size=n),
        "resolver": np.rint(x * 8192),
        "ruler_um": -1e3 * x + rng.normal(size=n),
        "t_nut": 24 + t / 60,
    }


def csv_file(path: Path, columns: Columns, separator: str = ",", decimal: str = ".") -> Path:
    lines = [separator.join(columns)]
    lines += [separator.join(repr(float(v)).replace(".", decimal) for v in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def map_file(path: Path, *changes: tuple[str, str], base: Path = BENCH) -> Path:
    text = base.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["log", "import", *map(str, arguments)])


def test_values_arrive_in_si_with_sign_scale_and_offset(tmp_path: Path) -> None:
    columns = bench()
    source = csv_file(tmp_path / "bench.csv", columns)
    plan = map_file(tmp_path / "map.yaml", ("{source: i_cmd, unit: A}", "{source: i_cmd, unit: mA, scale: 1000, offset: 0.01}"))
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    log = read_log(tmp_path / "a.mcap")
    rows = log.topics["/axis"]
    np.testing.assert_allclose(rows["load_m"], -1e-6 * columns["ruler_um"], rtol=1e-12)
    np.testing.assert_allclose(rows["command_a"], columns["i_cmd"] - 0.01, rtol=1e-12)
    assert rows["resolver_counts"].tolist() == columns["resolver"].astype(int).tolist()
    assert set(rows["load_force_n"]) == {-40.0}
    assert all(rows["enabled"])
    assert rows["stamp_ns"].tolist() == log.log_times["/axis"].tolist() == [10_000_000 * k for k in range(600)]
    assert rows["cycle"].tolist() == list(range(600))
    assert [(e["stamp_ns"], e["text"]) for e in log.events] == [(0, "sine"), (3_000_000_000, "reversals")]
    assert log.metadata["run"]["kind"] == "axis"
    assert log.metadata["run"]["rate_hz"] == "100"
    assert log.attachments["import-map.yaml"] == plan.read_bytes()


def test_same_recording_same_bytes_and_nothing_but_the_log(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench())
    for name in "ab":
        assert run(source, "--map", BENCH, "-o", tmp_path / name).exit_code == 0
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    assert {p.name for p in tmp_path.iterdir()} == {"bench.csv", "a", "b"}


def test_an_existing_file_is_kept_unless_forced(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench())
    out = tmp_path / "a.mcap"
    out.write_bytes(b"mine")
    assert run(source, "--map", BENCH, "-o", out).exit_code == 2
    assert out.read_bytes() == b"mine"
    assert run(source, "--map", BENCH, "-o", out, "--force").exit_code == 0
    assert run(source, "--map", BENCH, "-o", source, "--force").exit_code == 2
    assert run(source, "--map", BENCH, "-o", tmp_path / "no" / "a.mcap").exit_code == 2


def test_an_interrupted_import_leaves_nothing(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench())
    out = tmp_path / "a.mcap"
    out.write_bytes(b"mine")

    def interrupt(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_log(source, load_import_map(BENCH), out, force=True, progress=interrupt)
    assert out.read_bytes() == b"mine"
    assert {p.name for p in tmp_path.iterdir()} == {"bench.csv", "a.mcap"}


def _swap(c: Columns) -> None:
    c["time_ms"][[100, 101]] = c["time_ms"][[101, 100]]


def _still(c: Columns) -> None:
    c["time_ms"][300] = c["time_ms"][299]


def _set(name: str, at: int, value: float) -> Callable[[Columns], None]:
    return lambda c: c[name].__setitem__(at, value)


def _scale(name: str, factor: float) -> Callable[[Columns], None]:
    return lambda c: c.__setitem__(name, c[name] * factor)


def _hole(c: Columns) -> None:
    for name in c:
        c[name] = np.delete(c[name], slice(200, 240))


@pytest.mark.parametrize(
    ("spoil", "check"),
    [
        (_swap, "monotonic"),
        (_still, "monotonic"),
        (_set("time_ms", 50, 501.0), "jitter"),
        (_set("time_ms", 50, float("nan")), "time-finite"),
        (_set("ruler_um", 50, float("nan")), "nan"),
        (_set("i_cmd", 50, float("inf")), "finite"),
        (_hole, "gaps"),
        (_scale("ruler_um", -1.0), "reference-sign"),
        (_scale("ruler_um", 10.0), "reference-scale"),
        (_scale("i_meas_mA", -1.0), "current-sign"),
        (_scale("i_meas_mA", 1e-3), "current-scale"),
        (_scale("i_cmd", -1.0), "command-sign"),
        (_scale("resolver", -1.0), "resolver-sign"),
    ],
)
def test_what_is_wrong_is_refused_and_nothing_is_written(tmp_path: Path, spoil: Callable[[Columns], None], check: str) -> None:
    columns = bench()
    spoil(columns)
    source = csv_file(tmp_path / "bench.csv", columns)
    done = run(source, "--map", BENCH, "-o", tmp_path / "a.mcap", "--json")
    assert done.exit_code == 4, done.output
    report = json.loads(done.stdout)
    assert not report["written"]
    assert check in {c["name"] for c in report["checks"] if c["verdict"] == "refused"}
    assert check in done.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"bench.csv"}


def test_a_hole_that_is_allowed_shows_in_the_cycle(tmp_path: Path) -> None:
    columns = bench()
    _hole(columns)
    source = csv_file(tmp_path / "bench.csv", columns)
    plan = map_file(tmp_path / "map.yaml", ("max_jitter: 0.05", "max_gap_s: 0.5"))
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    cycles = read_log(tmp_path / "a.mcap").topics["/axis"]["cycle"]
    assert cycles[199:201].tolist() == [199, 240]
    assert "1 holes, the first after sample 200" in done.stdout


def test_a_known_failure_can_be_accepted_but_not_a_hole_of_numbers(tmp_path: Path) -> None:
    columns = bench()
    columns["ruler_um"] = columns["ruler_um"] * 10
    source = csv_file(tmp_path / "bench.csv", columns)
    plan = map_file(tmp_path / "map.yaml", ("controller: {kind", "accept: [reference-scale]\ncontroller: {kind"))
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    columns["ruler_um"][3] = np.nan
    csv_file(source, columns)
    plan = map_file(tmp_path / "map.yaml", ("controller: {kind", "accept: [nan]\ncontroller: {kind"))
    assert run(source, "--map", plan, "-o", tmp_path / "b.mcap").exit_code == 4


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("time_ms,demand_mm\n", "has no column 'i_cmd'"),
        ("a,a\n1,2\n", "two columns are called 'a'"),
        ("\0\1\2", "has no column"),
    ],
)
def test_tables_that_are_none(tmp_path: Path, text: str, words: str) -> None:
    source = tmp_path / "bench.csv"
    source.write_text(text, encoding="utf-8")
    done = run(source, "--map", BENCH, "-o", tmp_path / "a.mcap")
    assert done.exit_code in (2, 4)
    assert words in done.stderr
    assert not (tmp_path / "a.mcap").exists()


def test_a_cell_that_is_no_number_is_named(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench(50))
    lines = source.read_text(encoding="utf-8").splitlines()
    lines[10] = "oops," + lines[10].partition(",")[2]
    source.write_text("\n".join(lines), encoding="utf-8")
    done = run(source, "--map", BENCH)
    assert done.exit_code == 4
    assert f"{source}:11:1: 'oops' is not a number" in done.stderr
    lines[10] = "1,2"
    source.write_text("\n".join(lines), encoding="utf-8")
    assert f"{source}:11: 2 columns, column 3 is missing" in run(source, "--map", BENCH).stderr


def test_a_column_that_is_not_there_is_the_maps_mistake(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench(50))
    plan = map_file(tmp_path / "map.yaml", ("source: ruler_um", "source: ruler_mm"))
    done = run(source, "--map", plan)
    assert done.exit_code == 2
    assert f"{plan}:15:14: bench.csv has no column 'ruler_mm'; did you mean 'ruler_um'?" in done.stderr


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    columns = bench()
    source = csv_file(tmp_path / "bench.csv", columns, ";", ",")
    plan = map_file(tmp_path / "map.yaml", ('separator: ","', 'separator: ";", decimal: ","'))
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    np.testing.assert_allclose(read_log(tmp_path / "a.mcap").topics["/axis"]["load_m"], -1e-6 * columns["ruler_um"], rtol=1e-12)


def test_window_and_idle_between_motions(tmp_path: Path) -> None:
    source = csv_file(tmp_path / "bench.csv", bench())
    changes = (("max_jitter: 0.05", "from_s: 1, to_s: 5"), ("from_s: 3.0, to_s: 6.0", "from_s: 4.0, to_s: 4.5"))
    done = run(source, "--map", map_file(tmp_path / "map.yaml", *changes), "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    log = read_log(tmp_path / "a.mcap")
    assert len(log.topics["/axis"]) == 401
    assert [(e["stamp_ns"] * 1e-9, e["text"]) for e in log.events] == [(0.0, "sine"), (2.0, "idle"), (3.0, "reversals"), (3.5, "idle")]


@given(st.integers(10, 400), st.floats(1.0, 5000.0), st.floats(0.0, 0.015), st.integers(0, 2**31), st.floats(-1e3, 1e3))
@settings(max_examples=60, deadline=None)
def test_a_grid_with_little_jitter_is_found(n: int, rate: float, jitter: float, seed: int, start: float) -> None:
    t = start + (np.arange(n) + np.random.default_rng(seed).uniform(-jitter / 2, jitter / 2, n)) / rate
    grid, found = judge_time(t, Time(source="t", max_jitter=0.05))
    assert grid is not None
    assert grid.cycles.tolist() == list(range(n))
    assert not [c for c in found if c.verdict == "refused"]
    assert grid.rate_hz == pytest.approx(rate, rel=2.0 * jitter / n + 2e-5)


def test_a_clock_that_drifts_is_refused() -> None:
    _, found = judge_time(np.arange(1000) * 1.002e-3, Time(source="t", rate_hz=1000.0))
    assert [(c.name, c.verdict) for c in found if c.name == "rate"] == [("rate", "refused")]


def test_matlab_columns_of_every_shape(tmp_path: Path) -> None:
    columns = bench()
    source = tmp_path / "bench.mat"
    savemat(source, {"d": np.stack([columns["demand_mm"], columns["ruler_um"]], axis=1), "s": {"i": columns["i_cmd"]}, **columns})
    names = (("demand_mm", '"d(:, 1)"'), ("ruler_um", '"d(:,2)"'), ("i_cmd", "s.i"))
    changes = (("format: csv\n", ""), *((f"source: {old}", f"source: {new}") for old, new in names))
    done = run(source, "--map", map_file(tmp_path / "map.yaml", *changes), "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    rows = read_log(tmp_path / "a.mcap").topics["/axis"]
    np.testing.assert_array_equal(rows["load_m"], -1e-6 * columns["ruler_um"])
    np.testing.assert_array_equal(rows["command_a"], columns["i_cmd"])
    for bad, words in (("d(:,3)", "has no column"), ("s.j", "has no column"), ("d", "not one column")):
        plan = map_file(tmp_path / "map.yaml", ("format: csv\n", ""), ("source: demand_mm", f'source: "{bad}"'))
        assert words in run(source, "--map", plan).stderr


@pytest.mark.parametrize(
    ("head", "words"),
    [
        (b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(100), "save it in MATLAB with `save NAME -v7`"),
        (b"MATLAB 5.0 MAT-file" + bytes(200), "cannot be read"),
    ],
)
def test_other_matlab_files_are_refused_in_clear_words(tmp_path: Path, head: bytes, words: str) -> None:
    source = tmp_path / "bench.mat"
    source.write_bytes(head)
    done = run(source, "--map", EMPS)
    assert done.exit_code == 4
    assert words in done.stderr


def test_mdf4_of_one_raster_and_of_two(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf", reason="the extra `mf4` (asammdf) is not installed")
    columns = bench()
    t = columns.pop("time_ms") * 1e-3
    source = tmp_path / "bench.mf4"
    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([asammdf.Signal(v, t, name=name, unit="x") for name, v in columns.items()], common_timebase=True)
        mdf.append(asammdf.Signal(np.zeros(300), t[::2], name="slow"))
        mdf.save(source)
    changes = (("format: csv\n", ""), ("source: time_ms, unit: ms", "source: (master)"))
    done = run(source, "--map", map_file(tmp_path / "map.yaml", *changes), "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    np.testing.assert_array_equal(read_log(tmp_path / "a.mcap").topics["/axis"]["load_m"], -1e-6 * columns["ruler_um"])
    slow = map_file(tmp_path / "map.yaml", *changes, ("source: t_nut", "source: slow"))
    done = run(source, "--map", slow)
    assert done.exit_code == 4
    assert "has another time axis" in done.stderr
    source.write_bytes(source.read_bytes()[:200])
    assert run(source, "--map", slow).exit_code == 4


def test_mdf4_that_is_none_is_refused_without_the_package(tmp_path: Path) -> None:
    (tmp_path / "bench.mf4").write_bytes(b"time,x\n1,2\n")
    done = run(tmp_path / "bench.mf4", "--map", map_file(tmp_path / "map.yaml", ("format: csv\n", "")))
    assert done.exit_code == 4
    assert "is not an MDF file" in done.stderr


PLATFORM = """
schema: spsp-ctrl/import-map/1
name: platform
time: {rate_hz: 200}
columns:
  /measurement:
    imu.pitch_rad: {source: pitch, unit: deg}
    imu.gyro_y_rad_s: {source: q, unit: deg/s}
    drive_pitch.current_a: {source: i, unit: A}
constants:
  /measurement:
    drive_pitch.enabled: {value: 1}
held: [imu]
"""


def test_a_platform_has_samples_with_stamp_and_sequence(tmp_path: Path) -> None:
    t = np.arange(400) // 4 * 4 / 200.0  # the IMU is four times slower than the recording
    source = csv_file(tmp_path / "p.csv", {"pitch": np.sin(t), "q": np.cos(t), "i": np.sin(np.arange(400.0))})
    plan = tmp_path / "map.yaml"
    plan.write_text(PLATFORM, encoding="utf-8")
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    log = read_log(tmp_path / "a.mcap")
    rows = log.topics["/measurement"]
    assert rows["imu.seq"].tolist() == [k // 4 for k in range(400)]
    assert rows["imu.stamp_ns"].tolist() == [k // 4 * 20_000_000 for k in range(400)]
    assert all(rows["imu.valid"])
    assert rows["drive_pitch.seq"].tolist() == list(range(400))
    assert set(rows["drive_roll.seq"]) == {-1}
    np.testing.assert_allclose(rows["imu.pitch_rad"], np.radians(np.sin(t)), rtol=1e-12)
    csv_file(source, {"pitch": np.sin(t), "q": -np.cos(t), "i": t})
    done = run(source, "--map", plan)
    assert done.exit_code == 4
    assert "imu-pitch-sign" in done.stderr


@given(st.sampled_from([".csv", ".mat", ".mf4"]), st.binary(max_size=300), st.integers(0, 4000), st.integers(0, 300))
@settings(max_examples=120, deadline=None)
def test_damaged_files_are_refused_in_words(tmp_path_factory: pytest.TempPathFactory, ending: str, noise: bytes, at: int, cut: int) -> None:
    """Bytes put into a whole file, or nothing but bytes: never a traceback, and no log unless what was read passes every check."""
    folder = tmp_path_factory.mktemp("damaged")
    whole = folder / "whole.mat"
    if ending == ".csv":
        csv_file(whole, bench(120))
    elif ending == ".mat":
        savemat(whole, bench(120))
    else:
        whole.write_bytes(b"MDF     4.10    tool    " + bytes(500))
    data = whole.read_bytes()
    source = folder / f"bench{ending}"
    source.write_bytes(data[: at % len(data)] + noise + data[at % len(data) + cut :] if cut else noise)
    plan = map_file(folder / "map.yaml", ("format: csv\n", ""), ("  - {name: reversals, from_s: 3.0, to_s: 6.0}\n", ""))
    done = run(source, "--map", plan, "-o", folder / "a.mcap")
    assert done.exit_code in (0, 2, 4), done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert (folder / "a.mcap").exists() == (done.exit_code == 0)


def test_measurement_and_control_in_one_recording(tmp_path: Path) -> None:
    plan = tmp_path / "map.yaml"
    control = "  /control:\n    command.pitch_current_a: {source: i, unit: mA, sign: -1}\n    mode: {source: mode, unit: '1'}\n"
    plan.write_text(PLATFORM.replace("constants:", control + "constants:"), encoding="utf-8")
    t = np.arange(400) // 4 * 4 / 200.0
    source = csv_file(tmp_path / "p.csv", {"pitch": np.sin(t), "q": np.cos(t), "i": np.sin(np.arange(400.0)), "mode": np.full(400, 4.0)})
    done = run(source, "--map", plan, "-o", tmp_path / "a.mcap")
    assert done.exit_code == 0, done.output
    topics = read_log(tmp_path / "a.mcap").topics
    assert topics["/control"]["cycle"].tolist() == topics["/measurement"]["cycle"].tolist() == list(range(400))
    np.testing.assert_allclose(topics["/control"]["command.pitch_current_a"], -1e-3 * np.sin(np.arange(400.0)), rtol=1e-12)
    assert set(topics["/control"]["mode"]) == {4}
    assert topics["/control"]["command.seq"].tolist() == list(range(400))


@pytest.mark.skipif(not DATA.is_file(), reason="no EMPS data: put DATA_EMPS.mat into $SPSP_CTRL_DATA/emps")
def test_emps(tmp_path: Path) -> None:
    done = run(DATA, "--map", EMPS, "-o", tmp_path / "emps.mcap", "--json")
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    inertia = next(c["value"] for c in report["checks"] if c["name"] == "command-sign")
    assert inertia * 35.15 == pytest.approx(95.1, rel=0.05)  # published moving mass, 35.15 N/V
    log = read_log(tmp_path / "emps.mcap")
    assert len(log.topics["/axis"]) == 24841
    assert log.metadata["run"]["rate_hz"] == "1000"
    assert log.metadata["run"]["command_unit"] == "V"
    assert [e["stamp_ns"] for e in log.events] == [6_240_000_000 * k for k in range(4)]
    load = log.topics["/axis"]["load_m"]
    assert np.std(load[6240:12480] - load[12480:18720]) < 20e-6  # the laps do repeat
    known = AxisController.model_validate(yaml.safe_load(log.attachments["controller.yaml"]))
    rows = log.topics["/axis"]
    made = replay(
        rows["reference_m"], rows["reference_m_s"], load, 1000.0,
        kp=known.kp_1_s, kv=known.kv, feedforward=known.feedforward, limit=known.limit, rate_span=known.rate_span,
    )  # fmt: skip
    assert np.std((made - rows["command_a"])[10:]) < 0.02 * np.std(made)  # the law that the map declares made the recorded command
    assert len(digest_topics(tmp_path / "emps.mcap")) == 2
