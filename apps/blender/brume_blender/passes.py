"""Blender's render passes made of brume's layers. Knows NumPy and nothing of Blender.

Passes have the names that Cycles gives them, and add up as its do:

    Combined = (DiffDir + DiffInd) * DiffCol + VolumeDir + VolumeInd + Emit + Env

Light that surfaces reflect is in DiffDir and DiffInd whatever they are made of: brume does not tell it apart.
"""

from dataclasses import dataclass

import numpy as np

NOTHING = 1e10  # depth where no surface is met, as in Cycles


@dataclass(frozen=True)
class Pass:
    name: str
    components: str
    layers: tuple  # that must be recorded for it
    light: str = ""  # the layer of light that it shows, clean where that is

    @property
    def kind(self):
        return {"Z": "VALUE", "Y": "VALUE", "A": "VALUE", "XYZ": "VECTOR", "XYZW": "VECTOR"}.get(self.components, "COLOR")


# What the passes of light are made of: all of it together, so that what is cleaned adds up.
LIGHT = (
    "single", "surface", "background", "emission", "volume_indirect", "surface_indirect", "surface_emission", "surface_albedo",
)  # fmt: skip

COMBINED = Pass("Combined", "RGBA", ())
KNOWN = {
    p.name: p
    for p in (
        COMBINED,
        Pass("Depth", "Z", ("position", "surface_share")),
        Pass("Position", "XYZ", ("position", "surface_share")),
        Pass("Normal", "XYZ", ("normal",)),
        Pass("Mist", "Z", ("depths",)),
        Pass("Vector", "XYZW", ("motion",)),
        Pass("DiffCol", "RGB", LIGHT),
        Pass("DiffDir", "RGB", LIGHT),
        Pass("DiffInd", "RGB", LIGHT),
        Pass("VolumeDir", "RGB", LIGHT),
        Pass("VolumeInd", "RGB", LIGHT),
        Pass("Emit", "RGB", LIGHT),
        Pass("Env", "RGB", LIGHT),
        Pass("Noisy Image", "RGBA", ()),
    )
}
# What Blender calls them since version 5.
NAMES_SINCE_5 = {
    "DiffCol": "Diffuse Color",
    "DiffDir": "Diffuse Direct",
    "DiffInd": "Diffuse Indirect",
    "VolumeDir": "Volume Direct",
    "VolumeInd": "Volume Indirect",
    "Emit": "Emission",
    "Env": "Environment",
}


def blender_name(name, version):
    """@param version  of Blender, as numbers"""
    return NAMES_SINCE_5.get(name, name) if version >= (5, 0, 0) else name


# Layers that may be asked for by name, beside the passes, and what their channels are.
LAYERS = {
    "direct": "RGB", "indirect": "RGB", "background": "RGB", "emission": "RGB", "single": "RGB", "surface": "RGB",
    "surface_emission": "RGB", "volume_indirect": "RGB", "surface_indirect": "RGB", "gradient": "XYZ", "coverage": "A",
    "transmittance": "RGB", "scatter_depth": "Z", "scatter_position": "XYZ", "scatter_density": "Y", "scatter_share": "A",
    "optical_depth": "Y", "albedo": "RGB", "surface_albedo": "RGB", "surface_share": "A", "flash": "RGB", "catcher": "RGB",
    "catcher_unshadowed": "RGB",
}  # fmt: skip
# Those that every frame has, or every clean one.
GIVEN = {"sample_count": "Y", "clean_error": "Y"}


def light_passes(groups):
    """Of light groups, as Cycles names them. @param groups  brume's names by Blender's"""
    return [Pass(f"Combined_{name}", "RGB", (), f"light.{group}") for name, group in groups.items()]


def matte_passes(objects, materials, levels):
    """Cryptomatte, two levels in each pass. Its components are small letters, as Cycles has them: by these Blender knows that
    they must be packed without loss."""
    return [
        Pass(f"{name}{i:02}", "rgba", (layer,))
        for on, name, layer in ((objects, "CryptoObject", "cryptomatte_object"), (materials, "CryptoMaterial", "cryptomatte_material"))
        if on
        for i in range((levels + 1) // 2)
    ]


def matte_metadata(header, view_layer):
    """What the header of a frame says of its Cryptomatte layers, as Blender's picture of a view layer must.
    @return attributes by name"""
    found = {}
    for key, name in header.items():
        if not (key.startswith("cryptomatte/") and key.endswith("/name")):
            continue
        own = f"{view_layer}.{name}"
        prefix = f"cryptomatte/{murmur_hash(own.encode()):08x}"[:19] + "/"
        found[prefix + "name"] = own
        for what in ("hash", "conversion", "manifest"):
            found[prefix + what] = header[key.removesuffix("name") + what]
    return found


def murmur_hash(data):
    """MurmurHash3_x86_32 with seed 0, of bytes."""

    def turned(v, bits):
        return (v << bits | v >> 32 - bits) & 0xFFFFFFFF

    def mixed(k):
        return turned(k * 0xCC9E2D51 & 0xFFFFFFFF, 15) * 0x1B873593 & 0xFFFFFFFF

    h, whole = 0, len(data) // 4 * 4
    for i in range(0, whole, 4):
        h = turned(h ^ mixed(int.from_bytes(data[i : i + 4], "little")), 13) * 5 + 0xE6546B64 & 0xFFFFFFFF
    h ^= mixed(int.from_bytes(data[whole:], "little")) ^ len(data)
    for shift, factor in ((16, 0x85EBCA6B), (13, 0xC2B2AE35)):
        h = (h ^ h >> shift) * factor & 0xFFFFFFFF
    return h ^ h >> 16


def layers_for(passes, extra, transparent):
    """The names to give to --layers. @param extra  names of further layers   @param transparent  alpha is wanted"""
    names = ["direct", "indirect", *(["transmittance"] if transparent else [])]
    for p in passes:
        names += p.layers
    names += [layer for layer in extra if layer in LAYERS]
    return list(dict.fromkeys(names))


def extra_passes(names):
    """Passes for layers asked for by name. @return them, and the names that are no layers"""
    known = {**LAYERS, **GIVEN}
    found = [Pass(name, known[name], ()) for name in names if name in known]
    return found, [name for name in names if name not in known]


def picture(frame, transparent, exposure=1.0, name=""):
    """R G B A of the picture on top, or of another layer in its place. @param transparent  the film shows no background
    @param exposure  factor on its light"""
    colour = frame.layer(name, "RGB") * np.float32(exposure)
    mattes = any(channel.startswith("Crypto") for channel in frame.channels)
    if not transparent:
        alpha = np.ones((*colour.shape[:2], 1), np.float32)
    elif mattes:  # which add up to it
        alpha = frame.layer("", "A")
    elif (passed := frame.layer("clean_transmittance", "RGB")) is not None:
        alpha = np.clip(1 - passed.mean(axis=-1, keepdims=True), 0, 1)
    else:
        alpha = frame.layer("", "A")
    return np.concatenate([colour, alpha], axis=-1)


class Passes:
    """All that was asked for of one frame: arrays height x width x channels, rows from the top."""

    def __init__(self, frame, transparent, exposure=1.0):
        """@param exposure  factor on light"""
        self._frame, self._transparent, self._exposure = frame, transparent, exposure

    def values(self, p):
        if p.name in KNOWN:
            values = _MAKERS[p.name](self)
            return (values * self._exposure if p.layers == LIGHT and p.name != "DiffCol" else values).astype(np.float32)
        found = self._light(p.light) if p.light else self._frame.layer(p.name, p.components)
        if found is None:  # a group without lights
            return np.zeros((self._frame.height, self._frame.width, len(p.components)), np.float32)
        return (found * self._exposure).astype(np.float32) if p.light else found

    def _light(self, name):
        """A part of the light, clean where it was cleaned."""
        clean = self._frame.layer("clean_" + name, "RGB")
        return self._frame.layer(name, "RGB") if clean is None else clean

    def _surface_colour(self):
        return self._frame.layer("surface_albedo", "RGB")

    def _reflected(self, light):
        """Surfaces' light where there is a surface that reflects, and the rest: what a filter spread beyond its edges."""
        there = self._surface_colour() > 1e-6
        return np.where(there, light, 0), np.where(there, 0, light)

    def _surface_direct(self):
        return self._reflected(self._light("surface") - self._light("surface_emission"))

    def _surface_indirect(self):
        return self._reflected(self._light("surface_indirect"))

    def _over_colour(self, light):
        colour = self._surface_colour()
        return np.divide(light, colour, out=np.zeros_like(light, np.float64), where=light != 0)

    def _position(self):
        """Of the first surface, where one is met, and where that is."""
        share = self._frame.layer("surface_share", "A")
        met = share > 0
        return np.where(met, self._frame.layer("position", "XYZ") / np.where(met, share, 1), 0), met[..., 0]

    def _depth(self):
        """Along the view, as in Cycles."""
        position, met = self._position()
        camera = self._frame.header["worldToCamera"]  # row vectors; the view goes along -z
        z = -(position @ camera[:3, 2] + camera[3, 2])
        return np.where(met, z, NOTHING)[..., None]

    def _vector(self):
        """Pixels to where what is seen was, and from where it will be, y up."""
        was, will = (self._frame.layer("motion." + side, "XY") * [1, -1] for side in ("previous", "next"))
        return np.concatenate([was, -will], axis=-1)

    def _noisy(self):
        name = "noisy" if "noisy.R" in self._frame.channels else ""
        return picture(self._frame, self._transparent, self._exposure, name)


_MAKERS = {
    "Combined": lambda p: picture(p._frame, p._transparent, p._exposure),
    "Depth": lambda p: p._depth(),
    "Position": lambda p: p._position()[0],
    "Normal": lambda p: p._frame.layer("normal", "XYZ"),
    "Mist": lambda p: p._frame.layer("mist", "Y"),
    "Vector": lambda p: p._vector(),
    "DiffCol": lambda p: p._surface_colour(),
    "DiffDir": lambda p: p._over_colour(p._surface_direct()[0]),
    "DiffInd": lambda p: p._over_colour(p._surface_indirect()[0]),
    "VolumeDir": lambda p: p._light("single") + p._surface_direct()[1],
    "VolumeInd": lambda p: p._light("volume_indirect") + p._surface_indirect()[1],
    "Emit": lambda p: p._light("emission") + p._light("surface_emission"),
    "Env": lambda p: p._light("background"),
    "Noisy Image": lambda p: p._noisy(),
}
