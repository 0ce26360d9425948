"""Files of other programs: written, read back, refused."""

import numpy as np
import pytest
from conftest import drawn

import rcg


@pytest.mark.parametrize(
    ("name", "options", "format"),
    [
        ("a.bsdf", {"step_deg": 15, "resolution": 24}, "bsdf"),
        ("a.binary", {"to": "merl"}, "merl"),
        ("a.ssdd", {"step_deg": 30}, "ssdd"),
        ("a.xml", {}, "klems"),
        ("z.bsdf", {"to": "zemax", "step_deg": 30}, "zemax"),
        ("a.brdf", {"step_deg": 30}, "bird"),
        ("a.npy", {"step_deg": 30}, "npy"),
    ],
)
def test_every_format_goes_out_and_comes_back(name, options, format, tmp_path):
    path = tmp_path / name
    told = rcg.export("lambert:0.5", out=path, **options)
    assert told["format"] == format and told["bytes"] == path.stat().st_size
    assert rcg.info(path)["format"].endswith(f"({format})")
    wi, wo = drawn(50, 50, seed=1), drawn(50, 50, seed=2)
    np.testing.assert_allclose(rcg.Brdf(path).eval(wi, wo), 0.5 / np.pi, rtol=0.03)


def test_a_slice_is_a_table_of_text(tmp_path):
    rcg.export("ward:brass", out=tmp_path / "a.csv", incident_deg=(30, 45), step_deg=15)
    rows = (tmp_path / "a.csv").read_text().splitlines()
    assert any(row.startswith("30,45,") for row in rows)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"out": "a.txt"}, r"a\.txt: expected a file name that ends"),
        ({"out": "a.bsdf", "to": "obj"}, "^to: expected one of bsdf, .* found obj$"),
        ({"out": "a.txt", "to": "npy"}, r"a\.txt: expected a file name that ends in \.npy, found \.txt"),
        ({"out": "a.npy", "step_deg": 0.1}, "^step_deg: expected degrees from 0.5 to 45, found 0.1$"),
        ({"out": "a.npy", "step_deg": float("nan")}, "^step_deg: expected degrees from 0.5 to 45, found NaN$"),
        ({"out": "a.npy", "resolution": 8}, '^resolution: expected to="bsdf", found npy$'),
        ({"out": "a.npy", "incident_deg": (30, 0)}, '^incident_deg: expected to="csv", found npy$'),
        ({"out": "a.csv", "incident_deg": (95, 0)}, "incident_deg: expected"),
    ],
)
def test_what_cannot_be_exported_is_refused_and_nothing_is_written(options, sentence, tmp_path):
    options["out"] = tmp_path / options["out"]
    with pytest.raises(ValueError, match=sentence):
        rcg.export("lambert:0.5", **options)
    assert list(tmp_path.iterdir()) == []


def test_the_file_that_is_read_is_not_overwritten(tmp_path):
    path = tmp_path / "a.npy"
    rcg.export("lambert:0.5", out=path, step_deg=45)
    with pytest.raises(ValueError, match=r"a\.npy, out: expected another file"):
        rcg.export(path, out=path)


def test_a_folder_that_is_not_there_is_an_error_of_the_system(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        rcg.export("lambert:0.5", out=tmp_path / "nowhere" / "a.npy", step_deg=45)


def test_gaps_are_filled_and_say_so(cloth, whole):
    before, after = rcg.open(cloth).load(), rcg.open(whole).load()
    assert (after.f.isnull().sum() < before.f.isnull().sum()).item()
    kinds = dict(zip(after.provenance.attrs["flag_values"], after.provenance.attrs["flag_meanings"].split(), strict=True))
    assert {"measured", "reciprocal"} <= {kinds[code] for code in np.unique(after.provenance)}
    with pytest.raises(ValueError, match="^without: expected reciprocity, wire or model, found chance$"):
        rcg.fill(cloth, out=whole.parent / "b.zarr", without=["chance"])
    with pytest.raises(ValueError, match="^brdfs: expected at least one, found none$"):
        rcg.fill([], out=whole.parent / "b.zarr")


def test_info_tells_a_cloth_from_a_mirror(cloth):
    info = rcg.info(cloth)
    assert info["turned"] > 0.02 and info["exchanged"] < 0.05
    assert rcg.info("ggx:plastic")["turned"] < 0.01
