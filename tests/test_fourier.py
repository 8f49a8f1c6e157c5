import numpy as np
import pytest
import scipy

from texclass.fourier import BLOCK, irfft_quarters, rfft, rfft_quarters


@pytest.mark.parametrize("n", [4, 8, 12, 60, 1004, 8 * BLOCK, 8 * BLOCK + 12, 40_000])
def test_transforms_equal_those_of_scipy(n):
    x = np.random.default_rng(0).standard_normal(n).astype(np.float32)
    right = scipy.fft.rfft(x.astype(np.float64))
    atol = 1e-6 * np.abs(right).max()
    np.testing.assert_allclose(rfft(x), right, atol=atol)
    np.testing.assert_allclose(rfft(x, quarter=True), right[: n // 4 + 1], atol=atol)
    np.testing.assert_allclose(irfft_quarters(rfft_quarters(x), n), x, atol=1e-5)
