"""Mitsuba 3 as a judge: it evaluates what is exported and the files of others."""

import numpy as np
import pytest
from conftest import DATA, drawn

import rcg

mitsuba = pytest.importorskip("mitsuba", reason="no mitsuba (pip install -r requirements.txt)")
PAIRS = 2000
FILES = sorted(DATA.glob("*_rgb.bsdf"))


def by_mitsuba(path, wi, wo):
    """f in 1/sr [N, 3] at unit vectors [N, 3] by Mitsuba's plugin `measured`, in single precision."""
    mitsuba.set_variant("scalar_rgb")
    bsdf = mitsuba.load_dict({"type": "measured", "filename": str(path)})
    context, interaction = mitsuba.BSDFContext(), mitsuba.SurfaceInteraction3f()
    values = np.empty((len(wi), 3))
    for row, (light, view) in enumerate(zip(wi, wo, strict=True)):
        interaction.wi = mitsuba.ScalarVector3f(light)
        # Mitsuba's value has the cosine of the other direction in it.
        values[row] = np.array(bsdf.eval(context, interaction, mitsuba.ScalarVector3f(view))) / view[2]
    return values


def exported_agrees(source, out, **options):
    rcg.export(source, out=out, **options)
    wi, wo = drawn(PAIRS, 75, seed=3), drawn(PAIRS, 75, seed=4)
    ours, theirs = rcg.Brdf(source).eval(wi, wo), by_mitsuba(out, wi, wo)
    error = np.abs(theirs / ours - 1)
    print(f"{source}: median {np.median(error):.4%}, largest {error.max():.3%}")
    assert np.median(error) <= 0.005
    assert error.max() <= 0.03


def test_an_exported_measurement_of_cloth_is_the_same_in_mitsuba(whole, tmp_path):
    exported_agrees(whole, tmp_path / "cloth.bsdf")


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
def test_an_exported_file_of_rgl_is_the_same_in_mitsuba(tmp_path):
    exported_agrees(FILES[-1], tmp_path / "again.bsdf")


@pytest.mark.skipif(not FILES, reason=f"no files of the RGL database in {DATA}")
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_files_of_rgl_are_read_as_mitsuba_reads_them(path):
    wi, wo = drawn(PAIRS, 75, seed=5), drawn(PAIRS, 75, seed=6)
    ours, theirs = rcg.Brdf(path).eval(wi, wo), by_mitsuba(path, wi, wo)
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=1e-7)
