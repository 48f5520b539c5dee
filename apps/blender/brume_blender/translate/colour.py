"""Colours of linear Rec. 709, in NumPy: luminance, black bodies, hue, sRGB."""

import functools

import numpy as np

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
RGB_FROM_XYZ = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
COLDEST, HOTTEST = 800.0, 12000.0  # [K] colours stay as they are beyond


def luminance(rgb):
    return rgb @ LUMINANCE


# CIE 1931 2-degree colour matching functions, from 380 nm by 10 nm.
COLOUR_MATCHING = np.array([
    (0.001368, 0.000039, 0.00645), (0.004243, 0.00012, 0.02005), (0.01431, 0.000396, 0.06785),
    (0.04351, 0.00121, 0.2074), (0.13438, 0.004, 0.6456), (0.2839, 0.0116, 1.3856),
    (0.34828, 0.023, 1.74706), (0.3362, 0.038, 1.77211), (0.2908, 0.06, 1.6692),
    (0.19536, 0.09098, 1.28764), (0.09564, 0.13902, 0.81295), (0.03201, 0.20802, 0.46518),
    (0.0049, 0.323, 0.272), (0.0093, 0.503, 0.1582), (0.06327, 0.71, 0.07825),
    (0.1655, 0.862, 0.04216), (0.2904, 0.954, 0.0203), (0.43345, 0.99495, 0.00875),
    (0.5945, 0.995, 0.0039), (0.7621, 0.952, 0.0021), (0.9163, 0.87, 0.00165),
    (1.0263, 0.757, 0.0011), (1.0622, 0.631, 0.0008), (1.0026, 0.503, 0.00034),
    (0.85445, 0.381, 0.00019), (0.6424, 0.265, 0.00005), (0.4479, 0.175, 0.00002),
    (0.2835, 0.107, 0), (0.1649, 0.061, 0), (0.0874, 0.032, 0),
    (0.04677, 0.017, 0), (0.0227, 0.00821, 0), (0.011359, 0.004102, 0),
    (0.00579, 0.002091, 0), (0.002899, 0.001047, 0), (0.00144, 0.00052, 0),
    (0.00069, 0.000249, 0), (0.000332, 0.00012, 0), (0.000166, 0.00006, 0),
    (0.000083, 0.00003, 0), (0.000042, 0.000015, 0),
])  # fmt: skip


@functools.lru_cache(maxsize=1)
def _blackbody_table():
    kelvin = np.geomspace(COLDEST, HOTTEST, 512)
    nm = 380 + 10 * np.arange(len(COLOUR_MATCHING))
    planck = nm ** -5.0 / np.expm1(1.4387769e7 / (nm * kelvin[:, None]))
    rgb = planck @ COLOUR_MATCHING @ RGB_FROM_XYZ.T
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
