"""The trigger box, simulated by the firmware's own library in virtual time."""

import importlib.util
import threading
from pathlib import Path

import numpy as np
import pytest

import rcg
from rcg import _rcg


@pytest.fixture
def box():
    with rcg.TriggerBox("sim", rig="rcg-2") as box:
        yield box


def test_it_says_what_it_is(box):
    info = box.info()
    assert info["clock_hz"] == 125_000_000 and info["port"] and info["max_steps"] > 100
    assert box.status()["state"] == "idle"
    assert {flag.value: flag.name.lower().replace("_", "-") for flag in rcg.Flag} == dict(_rcg.TriggerBox.flags())


def test_edges_come_when_the_schedule_says(box):
    records = box.run(steps=12, exposures=[1e-3, "2ms", "500000ticks"], period="100 ms", cam_at="2 ms")
    assert records.dtype.names == ("step", "trigger_ticks", "strobe_delay_ticks", "strobe_width_ticks", "flags")
    np.testing.assert_array_equal(records["step"], np.arange(12))
    np.testing.assert_array_equal(records["trigger_ticks"], 250_000 + 12_500_000 * np.arange(12))
    np.testing.assert_array_equal(records["strobe_width_ticks"], np.tile([125_000.0, 250_000, 500_000], 4))
    assert (records["strobe_delay_ticks"] >= 0).all() and (records["flags"] == 0).all()
    assert box.status()["steps_done"] == 12


def test_what_the_camera_missed_is_nan_with_a_flag(box):
    records = box.run(steps=3, exposures=["1ms"], period="10 ms", cam_at="2 ms")
    missed = (records["flags"] & rcg.Flag.MISSED) != 0
    np.testing.assert_array_equal(missed, [False, True, True])
    np.testing.assert_array_equal(np.isnan(records["strobe_width_ticks"]), missed)


def test_a_stream_is_as_long_as_one_likes(box):
    count = 5000
    records = box.run(steps=count, stream=True, exposures=["20us"], cam_at="8us", period="50us", proj_width=5e-6)
    np.testing.assert_array_equal(records["step"], np.arange(count))
    assert (records["trigger_ticks"] == 1000 + 6250 * np.arange(count)).all()


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"steps": 0}, "^steps: expected a whole number from 1 to .* found 0$"),
        ({"steps": 7, "exposures": [1e-3, 2e-3]}, "^steps: expected a multiple of 2, .* found 7$"),
        ({"steps": 1.5}, "^steps: expected a whole number from 1 to .* found 1.5$"),
        ({"steps": 1, "period": "soon"}, "^period: expected a time with its unit .* found soon$"),
        ({"steps": 1, "period": -1.0}, "^period: expected a time .* found -1.0s$"),
        ({"steps": 1, "period": float("nan")}, "^period: expected a time .* found nans$"),
        ({"steps": 1, "period": "1ms", "exposures": ["2ms"]}, "step 0: expected .* found"),
        ({"steps": 1, "dead_man": "1ms"}, "^dead_man: expected 0 for none or from 0.02 s to 4294 s"),
        ({"steps": 1, "active_low": ["lamp"]}, "^active_low: expected proj, cam, sync or strobe, found lamp$"),
    ],
)
def test_what_the_box_cannot_make_is_refused_in_one_sentence(box, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        box.run(**options)
    assert box.status()["state"] == "idle"


def test_a_run_that_waits_for_sync_in_vain_is_an_error(box):
    with pytest.raises(RuntimeError, match="expected 3 steps, found an end after 0"):
        box.run(steps=3, each_on_sync=True, sync_timeout="1us")
    assert len(box.run(steps=3)) == 3


def test_threads_take_turns(box):
    lengths = []
    threads = [threading.Thread(target=lambda: lengths.append(len(box.run(steps=50)))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert lengths == [50] * 4


def test_ports_that_are_none_and_boxes_that_were_closed_are_told():
    with pytest.raises(ValueError, match="nowhere: expected a serial port"):
        rcg.TriggerBox("nowhere")
    with pytest.raises(OSError, match="port /dev/null: cannot be opened"):
        rcg.TriggerBox("/dev/null")
    box = rcg.TriggerBox("sim")
    box.close()
    box.close()
    with pytest.raises(ValueError, match="closed"):
        box.info()


def test_the_example_for_bluesky_takes_a_reading():
    pytest.importorskip("ophyd_async", reason="no ophyd-async (pip install -r requirements.txt)")
    path = Path(__file__).parents[1] / "examples" / "ophyd_trigger_box.py"
    spec = importlib.util.spec_from_file_location("ophyd_trigger_box", path)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    events = example.main("sim")
    assert [event["data"]["box-fired"] for event in events] == [30, 30]
