import numpy as np
import pytest

from seatrial.core.errors import InputError
from seatrial.selection.subsets.gram import gram
from seatrial.selection.thresholded import thresholded_least_squares
from tests.selection.subsets.naive import NAMES


def data(n=400, seed=0, k=12):
    """Four real terms of twelve, columns of sizes over two decades."""
    random, size = np.random.default_rng(seed), np.geomspace(0.1, 10, k)
    phi = (random.normal(size=(n, k)) + 0.5 * random.normal(size=(n, 1))) * size
    true = np.zeros(k)
    true[[1, 4, 6, 9]] = [1.0, -0.7, 0.8, 0.6]
    return phi, phi @ (true / size) + random.normal(size=n)


def naive(phi, y, threshold):
    """By rows and by the book, on columns of unit size."""
    scaled = phi / np.sqrt((phi**2).mean(0))
    c = np.linalg.lstsq(scaled, y)[0]
    for _ in range(20):
        small = np.abs(c) < threshold
        c[small] = 0.0
        if (~small).any():
            c[~small] = np.linalg.lstsq(scaled[:, ~small], y)[0]
    return c / np.sqrt((phi**2).mean(0))


def test_path_against_the_naive_twin():
    phi, y = data(60)
    path = (1e-6, 0.05, 0.2, 0.5, 0.9, 3.0)
    found = thresholded_least_squares(gram(phi, y), NAMES[:12], thresholds=path)
    for threshold, coefficients in zip(path, found.coefficients, strict=True):
        np.testing.assert_allclose(coefficients, naive(phi, y, threshold), atol=1e-10)
    left = [np.sum((y - phi @ c) ** 2) for c in found.coefficients]
    bic = 60 * np.log(np.array(left) / 60) + np.log(60) * (found.coefficients != 0).sum(1)
    np.testing.assert_allclose(found.criterion, bic)
    assert found.structures[0] == 2**12 - 1
    assert found.structures[-1] == 0


def test_truth_is_found_with_plenty_of_data():
    phi, y = data()
    folds = [gram(phi[i::5], y[i::5]) for i in range(5)]
    assert thresholded_least_squares(gram(phi, y), NAMES[:12]).terms == ("b", "e", "g", "j")
    by_prediction = thresholded_least_squares(gram(phi, y), NAMES[:12], folds=folds)
    assert set(by_prediction.terms) >= {"b", "e", "g", "j"}
    c = [naive(np.delete(phi, np.s_[i::5], 0), np.delete(y, np.s_[i::5]), 0.3) for i in range(5)]
    expected = sum(np.sum((y[i::5] - phi[i::5] @ c[i]) ** 2) for i in range(5)) / y.size
    once = thresholded_least_squares(gram(phi, y), NAMES[:12], folds=folds, thresholds=[0.3])
    assert once.criterion[0] == pytest.approx(expected, rel=1e-9)


def test_certain_terms_stay_and_units_decide_nothing():
    phi, y = data()
    kept = thresholded_least_squares(gram(phi, y), NAMES[:12], always=["l"], thresholds=[0.3])
    assert kept.terms == ("b", "e", "g", "j", "l")
    size = np.geomspace(100, 0.01, 12)
    one, two = (thresholded_least_squares(gram(x, y), NAMES[:12]) for x in (phi, phi * size))
    assert one.terms == two.terms
    np.testing.assert_allclose(one.coefficients, two.coefficients * size, atol=1e-12)


def test_bad_questions():
    phi, y = data()
    stats = gram(phi, y)
    for options, said in [
        ({"always": ["z"]}, "terms of the library"),
        ({"thresholds": [0.1, -1.0]}, "positive numbers"),
        ({"thresholds": []}, "positive numbers"),
        ({"folds": [stats]}, "at least two"),
        ({"folds": [stats, stats]}, "of 400 together"),
        ({"folds": [gram(phi[:5], y[:5]), gram(phi[5:], y[5:])]}, "5 measurements for 12 terms"),
    ]:
        with pytest.raises(InputError, match=said):
            thresholded_least_squares(stats, NAMES[:12], **options)
    phi[:, 3] = phi[:, 2]
    with pytest.raises(InputError, match="c and d are proportional"):
        thresholded_least_squares(gram(phi, y), NAMES[:12])


def test_the_path_goes_from_nearly_every_term_to_none():
    """Forty thresholds from a thousandth of the largest coefficient of the full fit to just beyond it."""
    phi, y = data()
    full = np.abs(naive(phi, y, 0.0) * np.sqrt((phi**2).mean(0))).max()
    found = thresholded_least_squares(gram(phi, y), NAMES[:12])
    np.testing.assert_allclose(found.thresholds, full * 1001 ** (np.arange(40) / 39) * 1e-3, rtol=1e-9)
    assert found.structures[-1] == 0
    assert int(found.structures[0]).bit_count() > 6


def test_parts_need_not_determine_every_term_alone():
    """Three parts of eight rows for twelve terms: any two of them do together."""
    phi, y = data(24)
    folds = [gram(phi[i::3], y[i::3]) for i in range(3)]
    found = thresholded_least_squares(gram(phi, y), NAMES[:12], folds=folds, thresholds=[0.3])
    c = [naive(np.delete(phi, np.s_[i::3], 0), np.delete(y, np.s_[i::3]), 0.3) for i in range(3)]
    expected = sum(np.sum((y[i::3] - phi[i::3] @ c[i]) ** 2) for i in range(3)) / 24
    assert found.criterion[0] == pytest.approx(expected, rel=1e-9)
