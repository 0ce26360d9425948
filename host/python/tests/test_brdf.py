"""Values at arrays of directions: shapes, layouts, what is missing, what is refused."""

import threading

import numpy as np
import pytest
from conftest import drawn

import rcg
from rcg import _rcg

UP = np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def brdf(cloth):
    return rcg.Brdf(cloth)


def test_all_ways_to_hold_a_measurement_have_the_same_values(cloth):
    wi, wo = drawn(5000, 89.9, seed=1), drawn(5000, 89.9, seed=2)
    for interpolation in ("blended", "half-vector", "direct"):
        held, file = (
            rcg.Brdf(cloth, interpolation=interpolation, in_memory=in_memory) for in_memory in (True, False)
        )
        values = held.eval(wi, wo)
        assert np.isfinite(values).mean() > 0.5
        np.testing.assert_allclose(values, file.eval(wi, wo), rtol=1e-6)
        np.testing.assert_array_equal(held.reason(wi, wo), file.reason(wi, wo))


@pytest.mark.parametrize("source", ["cloth", "ward:brass"])
def test_layout_and_type_of_arrays_do_not_matter(source, cloth):
    brdf = rcg.Brdf(cloth if source == "cloth" else source)
    wi, wo = drawn(300, 80, seed=1), drawn(300, 80, seed=2)
    values = brdf.eval(wi, wo)
    assert values.shape == (300, 3) and values.dtype == np.float64 and values.flags.c_contiguous
    wide = np.zeros((600, 7))
    wide[::2, 1:7:2] = wi
    layouts = {
        "Fortran": np.asfortranarray(wi),
        "strided": wide[::2, 1:7:2],
        "backwards": wi[::-1].copy()[::-1],
        "big-endian": wi.astype(">f8"),
        "list": wi.tolist(),
    }
    for name, other in layouts.items():
        np.testing.assert_array_equal(brdf.eval(other, wo), values, err_msg=name)
    single = wi.astype(np.float32)
    np.testing.assert_allclose(brdf.eval(single, wo.astype(np.float32)), values, rtol=1e-4)
    read_only = wi.copy()
    read_only.flags.writeable = False
    np.testing.assert_array_equal(brdf.eval(read_only, wo), values)


def test_shapes_broadcast_as_numpy_has_them(brdf):
    wo = drawn(12, 60)
    assert brdf.eval(UP, UP).shape == (3,)
    assert brdf.eval(UP, wo).shape == (12, 3)
    assert brdf.eval(wo[:, None], wo[:5]).shape == (12, 5, 3)
    assert brdf.reason(wo[:, None], wo[:5]).shape == (12, 5)
    np.testing.assert_array_equal(brdf.eval(wo[:, None], wo[:5])[3, 2], brdf.eval(wo[3], wo[2]))
    empty = np.empty((0, 3))
    assert brdf.eval(empty, empty).shape == (0, 3)
    assert brdf.sigma(empty, UP).shape == (0, 3)
    assert brdf.reason(empty, empty).shape == (0,)


def test_what_has_no_value_is_nan_with_a_reason(brdf):
    wi, wo = drawn(4000, 89.9, seed=7), drawn(4000, 89.9, seed=8)
    wi[0], wo[1], wi[2] = [1, 0, 0], [0, 0, -1], -UP
    values, sigma, reason = brdf.eval(wi, wo), brdf.sigma(wi, wo), brdf.reason(wi, wo)
    assert reason.dtype == np.uint8
    np.testing.assert_array_equal(np.isnan(values).all(-1), reason != 0)
    np.testing.assert_array_equal(np.isnan(values), np.isnan(sigma))
    assert (sigma[reason == 0] >= 0).all()
    assert (reason[:3] == rcg.Reason.BELOW_HORIZON).all()


def test_reasons_are_those_of_the_library():
    words = {reason.value: reason.words for reason in rcg.Reason if reason}
    assert words == dict(_rcg.reasons())


@pytest.mark.parametrize(
    ("wi", "sentence"),
    [
        ([1, 0], r"^wi: expected vectors \[\.\.\., 3\], found an array \[2\]$"),
        (1.0, r"^wi: expected vectors \[\.\.\., 3\], found an array \[\]$"),
        (np.zeros((3, 4)), r"^wi: expected vectors \[\.\.\., 3\], found an array \[3, 4\]$"),
        ([[0, 0, 1], [0, 0]], r"^wi: expected an array of numbers, found rows of different lengths$"),
        ("abc", r"^wi: expected an array of numbers, found one of <U3$"),
        ([None, 0, 1], r"^wi: expected an array of numbers, found one of object$"),
        (np.array([0, 0, 1j]), r"^wi: expected an array of numbers, found one of complex128$"),
        (np.ma.masked_array([0.0, 0, 1], mask=[1, 0, 0]), r"^wi: expected an array of numbers, found a masked one$"),
        ([True, False, True], r"^wi: expected an array of numbers, found one of bool$"),
        ([[0, 0, 1]] * 7, r"^wi, wo: expected shapes that broadcast, found \[7, 3\] and \[4, 3\]$"),
        ([0, 0, 2], r"^wi\[0\]: expected a unit vector, found \(0, 0, 2\), whose length is 2$"),
        ([0, 0, 0], r"^wi\[0\]: expected a unit vector, found \(0, 0, 0\), whose length is 0$"),
        ([[0, 0, 1], [0, np.nan, 1], UP, UP], r"^wi\[1\]: expected a unit vector, found \(0, NaN, 1\), .* NaN$"),
        ([0, np.inf, 0], r"^wi\[0\]: expected a unit vector, found \(0, inf, 0\), whose length is inf$"),
    ],
)
def test_arrays_that_are_no_directions_are_refused_in_one_sentence(brdf, wi, sentence):
    for ask in (brdf.eval, brdf.sigma, brdf.reason):
        with pytest.raises(ValueError, match=sentence):
            ask(wi, [UP] * 4)


@pytest.mark.parametrize(
    ("source", "kind", "sentence"),
    [
        ("ward:gold", ValueError, "expected .* found"),
        ("lambert:2", ValueError, "expected .* found"),
        ("no such file", ValueError, "expected lambert, ward"),
        ("nowhere.bsdf", FileNotFoundError, r"nowhere\.bsdf: expected a readable file"),
        ("nowhere.zarr", (ValueError, OSError), r"nowhere\.zarr"),
        ("", ValueError, "expected"),
        ("a\0b", (ValueError, OSError), "expected"),
    ],
)
def test_sources_that_are_none_are_refused_in_one_sentence(source, kind, sentence):
    with pytest.raises(kind, match=sentence) as caught:
        rcg.Brdf(source)
    assert "\n" not in str(caught.value)


def test_a_path_may_be_text_bytes_or_a_path(cloth):
    for path in (str(cloth), bytes(cloth), cloth):
        assert rcg.Brdf(path).channels == 3
    with pytest.raises(TypeError):
        rcg.Brdf(5)


def test_a_file_that_was_cut_is_refused(tmp_path):
    path = tmp_path / "cut.bsdf"
    path.write_bytes(b"tensor_file\0\1\0")
    with pytest.raises(ValueError, match=r"cut\.bsdf, .*expected"):
        rcg.Brdf(path)


def test_only_measurements_have_sigma_and_other_words_are_refused():
    with pytest.raises(ValueError, match=r"^sigma: expected a brdf\.zarr, .* found ward:brass$"):
        rcg.Brdf("ward:brass").sigma(UP, UP)
    with pytest.raises(ValueError, match=r"^interpolation: expected one of direct, .*, found cubic$"):
        rcg.Brdf("ward:brass", interpolation="cubic")


def test_threads_get_what_one_gets_alone(brdf):
    wi, wo = drawn(40_000, 80, seed=1), drawn(40_000, 80, seed=2)
    alone = brdf.eval(wi, wo)
    together = [None] * 4

    def ask(place):
        together[place] = brdf.eval(wi, wo)

    threads = [threading.Thread(target=ask, args=(place,)) for place in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for values in together:
        np.testing.assert_array_equal(values, alone)


def test_degrees_and_vectors_are_inverse():
    w = drawn(1000, 180)
    theta, phi = rcg.to_degrees(w)
    np.testing.assert_allclose(rcg.from_degrees(theta, phi), w, atol=1e-14)
    assert rcg.from_degrees(np.zeros((4, 1)), np.zeros(5)).shape == (4, 5, 3)
    with pytest.raises(ValueError, match="theta: expected an array of numbers"):
        rcg.from_degrees("45", 0)
