"""Measuring from Python: the same as the command does, refused in one sentence, ended by Ctrl-C."""

import os
import signal
import threading
import time

import numpy as np
import pytest

import rcg

SMALL = {"rig": "rcg-2", "step_deg": 30, "image_size": 16}


def test_a_seed_makes_the_same_measurement_again(tmp_path):
    first, second, other = (
        rcg.measure(tmp_path / name, seed=seed, sample_name="plate 3", operator="A. Name", **SMALL)
        for name, seed in (("a", 7), ("b", 7), ("c", 8))
    )
    assert first["sample"] == "plate 3" and first["evaluation"]["coverage"] is not None
    assert (tmp_path / "a" / "report.html").is_file() and "A. Name" in (tmp_path / "a" / "session.json").read_text()
    assert second["out"].endswith("b")
    f = [rcg.open(tmp_path / name).f.values for name in "abc"]
    np.testing.assert_array_equal(f[0], f[1])
    assert not np.array_equal(f[0], f[2], equal_nan=True)


def test_directions_may_be_an_array_or_a_file(tmp_path):
    directions = np.array([[10.0, 0], [40, 90], [60, 200], [30, 300]])
    file = tmp_path / "directions.txt"
    np.savetxt(file, directions)
    counts = [rcg.plan(grid=grid, rig="rcg-2")["grid_directions"] for grid in (directions, file, str(file))]
    assert counts == [4, 4, 4]
    even = rcg.plan(grid="equal-solid-angle", step_deg=15, rig="rcg-2")
    assert even["grid"] == "equal-solid-angle" and even["grid_directions"] < 144


def test_directions_are_chosen_on_the_way_until_a_budget(tmp_path):
    small = {"rig": "rcg-2", "image_size": 16, "sample": "ward:brass", "seed": 5}
    start = {"grid": "equal-solid-angle", "step_deg": 30}
    chosen = rcg.measure(tmp_path / "a", budget=40, **start, **small)
    result = rcg.open(tmp_path / "a")
    fixed = rcg.plan(**start, **small)["grid_directions"]
    assert fixed < result.sizes["incident"] <= 40 and chosen["evaluation"]["coverage"] is not None
    # What is done is what was asked for, and nothing else.
    again = rcg.measure(tmp_path / "a", budget=40, resume=True, **start, **small)
    assert again["evaluation"] == chosen["evaluation"]
    with pytest.raises(ValueError, match="goal"):
        rcg.measure(tmp_path / "a", budget=41, resume=True, **start, **small)
    rcg.measure(tmp_path / "b", **SMALL)
    with pytest.raises(ValueError, match="begun with target_db or budget, found one of a"):
        rcg.measure(tmp_path / "b", rig="rcg-2", budget=40, resume=True)


def test_a_plan_tells_time_and_bytes():
    plan = rcg.plan(rig="rcg-2", step_deg=15, brackets=[1.0, 3.5], image_size=32)
    assert plan["exposures_s"] == [0.001, 0.0035] and plan["instrument_s"] > 0
    assert plan["disk_space"]["raw_bytes"] > 144 * 32 * 32 * 3 * 2


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"step_deg": 7}, "^step: expected a number of degrees .* found 7$"),
        ({"step_deg": float("nan")}, "^step_deg: expected a finite number, found nan$"),
        ({"rig": "rcg-9"}, "rcg-9"),
        ({"sample": "ward:gold"}, "ward:gold"),
        ({"image_size": 3}, "expected .* found 3"),
        ({"image_size": "big"}, "^image_size: expected a whole number .* found big$"),
        ({"image_size": 48.5}, "^image_size: expected a whole number .* found 48.5$"),
        ({"brackets": "lots"}, "^brackets: .*lots.* expected `auto`"),
        ({"seed": -1}, "^seed: expected a whole number from 0 to .* found -1$"),
        ({"light": "disco"}, "^light: .*disco.* expected `single`"),
        ({"tilt": (95, 0)}, "^tilt: .*expected TILT:TOWARDS"),
        ({"spot_deg": 100}, "^spot_deg: expected a number of degrees from .* found 100$"),
        ({"exposure_s": 1e-9}, "expected .* found"),
        ({"exposure_s": 1e-3, "brackets": 3}, "^exposure_s: expected none beside brackets"),
        ({"grid": np.zeros((3, 3)), "step_deg": None}, r"^grid: expected finite angles .* found an array \[3, 3\]$"),
        ({"grid": [[10, 0], [20, 0]], "step_deg": None}, "expected at least 3 directions, found 2"),
        ({"grid": "nowhere.txt", "step_deg": None}, r"nowhere\.txt"),
        ({"grid": "nowhere.txt"}, "^step_deg: expected none with a list of directions, found 30"),
        ({"calibration": "nowhere"}, "nowhere"),
        ({"budget": 0}, "expected .* found 0"),
        ({"budget": 2.5}, "^budget: expected a whole number .* found 2.5$"),
        ({"target_db": float("inf")}, "^target_db: expected a finite number, found inf$"),
        ({"target_db": 500}, "^target: expected a PSNR .* found `500`$"),
        ({"target_db": 30, "light": "multiplexed"}, "expected .* found"),
        ({"sample_name": "a\nb"}, "^sample_name: expected some words on one line"),
    ],
)
def test_what_cannot_be_measured_is_refused_and_nothing_is_written(options, sentence, tmp_path):
    out = tmp_path / "m"
    with pytest.raises((ValueError, OSError), match=sentence):
        rcg.measure(out, **{**SMALL, **options})
    assert not out.exists()


def test_unknown_options_are_refused():
    with pytest.raises(TypeError, match="stepp"):
        rcg.plan(stepp=3)


def test_what_is_there_is_not_overwritten(cloth):
    with pytest.raises(ValueError, match="cloth"):
        rcg.measure(cloth, **SMALL)


def test_what_the_system_refuses_is_an_error_of_the_system(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match="file"):
        rcg.measure(tmp_path / "file" / "m", **SMALL)


@pytest.fixture
def heard():
    """Ctrl-C is heard, also where whoever began the tests has it ignored (as `nohup` and shells without a terminal do)."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
def test_ctrl_c_ends_a_measurement_that_can_go_on(tmp_path):
    options = {"rig": "rcg-2", "step_deg": 3, "image_size": 48}
    out = tmp_path / "m"

    def interrupt():
        while not (out / "raw.zarr").exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    with pytest.raises(KeyboardInterrupt):
        rcg.measure(out, **options)
    assert not (out / "brdf.zarr").exists()
    with pytest.raises(ValueError, match="step|grid|sample|seed|plan"):
        rcg.measure(out, resume=True, **{**options, "seed": 5})
    summary = rcg.measure(out, resume=True, rig="rcg-2")
    assert summary["incident_directions"] == 3600 and rcg.open(out).sizes["incident"] == 3600
