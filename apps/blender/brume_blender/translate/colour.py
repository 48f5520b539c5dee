"""Colours of linear Rec. 709, in NumPy: luminance, black bodies, hue, sRGB."""

import functools

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
RGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
COLDEST, HOTTEST = 800.0, 12000.0  # [K] colours stay as they are beyond


def luminance(rgb):
    return rgb @ LUMINANCE


def _xyz_weights(nm):
    """CIE 1931 2-degree observer, the multi-lobe fit of Wyman, Sloan and Shirley 2013."""

    def lobe(centre, below, above):
        return np.exp(-0.5 * ((nm - centre) * np.where(nm < centre, below, above)) ** 2)

    return np.stack(
        [
            0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.0490, 0.0382),
            0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322),
            1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725),
        ]
    )


@functools.lru_cache(maxsize=1)
def _blackbody_table():
    kelvin = np.geomspace(COLDEST, HOTTEST, 512)
    nm = np.arange(360.0, 831.0, 2.0)
    planck = nm**-5.0 / np.expm1(1.4387769e7 / (nm * kelvin[:, None]))
    rgb = planck @ _xyz_weights(nm).T @ RGB_FROM_XYZ.T
    return np.log(kelvin), rgb / luminance(rgb)[:, None]


def blackbody(kelvin):
    """Colour of a black body of luminance 1, as Blender's Blackbody node gives it; channels may be negative.
    @param kelvin  array of any shape   @return  that shape and three"""
    log_kelvin, rgb = _blackbody_table()
    x = np.log(np.clip(kelvin, COLDEST, HOTTEST))
    return np.stack([np.interp(x, log_kelvin, rgb[:, c]) for c in range(3)], axis=-1)


def hsv_from_rgb(rgb):
    largest, smallest = rgb.max(-1), rgb.min(-1)
    delta = largest - smallest
    safe = np.where(delta > 0, delta, 1)
    r, g, b = (rgb[..., c] for c in range(3))
    hue = np.where(largest == r, (g - b) / safe, np.where(largest == g, 2 + (b - r) / safe, 4 + (r - g) / safe)) / 6
    hue = np.where(delta > 0, hue % 1.0, 0)
    return np.stack([hue, np.where(largest > 0, delta / np.where(largest > 0, largest, 1), 0), largest], -1)


def rgb_from_hsv(hsv):
    h, s, v = (hsv[..., c] for c in range(3))
    ramps = np.clip(np.abs((h[..., None] * 6 + np.array([0, 4, 2])) % 6 - 3) - 1, 0, 1)
    return v[..., None] * (1 - s[..., None] * (1 - ramps))


def linear_from_srgb(v):
    return np.where(v < 0.04045, v / 12.92, ((np.maximum(v, 0) + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(v):
    return np.where(v < 0.0031308, v * 12.92, 1.055 * np.maximum(v, 0) ** (1 / 2.4) - 0.055)
