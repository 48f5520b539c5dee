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

    @property
    def kind(self):
        return {"Z": "VALUE", "Y": "VALUE", "A": "VALUE", "XYZ": "VECTOR"}.get(self.components, "COLOR")


PARTS = ("direct", "indirect", "single", "surface", "background", "emission", "volume_indirect", "surface_indirect")
COLOURED = PARTS + ("surface_emission", "surface_albedo")

COMBINED = Pass("Combined", "RGBA", ())
KNOWN = {
    p.name: p
    for p in (
        COMBINED,
        Pass("Depth", "Z", ("position", "surface_share")),
        Pass("Position", "XYZ", ("position", "surface_share")),
        Pass("Normal", "XYZ", ("normal",)),
        Pass("DiffCol", "RGB", COLOURED),
        Pass("DiffDir", "RGB", COLOURED),
        Pass("DiffInd", "RGB", COLOURED),
        Pass("VolumeDir", "RGB", PARTS),
        Pass("VolumeInd", "RGB", PARTS),
        Pass("Emit", "RGB", PARTS + ("surface_emission",)),
        Pass("Env", "RGB", PARTS),
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


def layers_for(passes, extra):
    """The names to give to --layers. @param extra  names of further layers"""
    names = ["direct", "indirect"]
    for p in passes:
        names += p.layers
    names += [layer for layer in extra if layer in LAYERS]
    return list(dict.fromkeys(names))


def extra_passes(names):
    """Passes for layers asked for by name. @return them, and the names that are no layers"""
    known = {**LAYERS, **GIVEN}
    found = [Pass(name, known[name], ()) for name in names if name in known]
    return found, [name for name in names if name not in known]


def picture(frame, transparent, name=""):
    """R G B A of the picture on top, or of another layer in its place. @param transparent  the film shows no background"""
    colour = frame.layer(name, "RGB")
    alpha = frame.layer("", "A") if transparent else np.ones((*colour.shape[:2], 1), np.float32)
    return np.concatenate([colour, alpha], axis=-1)


class Passes:
    """All that was asked for of one frame: arrays height x width x channels, rows from the top."""

    def __init__(self, frame, transparent):
        self._frame, self._transparent = frame, transparent

    def values(self, p):
        if p.name in KNOWN:
            return _MAKERS[p.name](self).astype(np.float32)
        found = self._frame.layer(p.name, p.components)
        height, width = self._frame.height, self._frame.width
        return np.zeros((height, width, len(p.components)), np.float32) if found is None else found

    def _light(self, name):
        """A part of the light, clean where it was cleaned."""
        clean = self._frame.layer("clean_" + name, "RGB")
        return self._frame.layer(name, "RGB") if clean is None else clean

    def _surface_colour(self):
        """Where light comes from a surface that reflects nothing, the factor is 1, so that the sum holds."""
        colour = self._frame.layer("surface_albedo", "RGB")
        light = np.abs(self._surface_direct()) + np.abs(self._light("surface_indirect"))
        return np.where((colour <= 1e-6) & (light > 0), 1.0, colour)

    def _surface_direct(self):
        return self._light("surface") - self._light("surface_emission")

    def _over_colour(self, light):
        colour = self._surface_colour()
        return np.divide(light, colour, out=np.zeros_like(light, np.float64), where=colour > 0)

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

    def _noisy(self):
        name = "noisy" if "noisy.R" in self._frame.channels else ""
        return picture(self._frame, self._transparent, name)


_MAKERS = {
    "Combined": lambda p: picture(p._frame, p._transparent),
    "Depth": lambda p: p._depth(),
    "Position": lambda p: p._position()[0],
    "Normal": lambda p: p._frame.layer("normal", "XYZ"),
    "DiffCol": lambda p: p._surface_colour(),
    "DiffDir": lambda p: p._over_colour(p._surface_direct()),
    "DiffInd": lambda p: p._over_colour(p._light("surface_indirect")),
    "VolumeDir": lambda p: p._light("single"),
    "VolumeInd": lambda p: p._light("volume_indirect"),
    "Emit": lambda p: p._light("emission") + p._light("surface_emission"),
    "Env": lambda p: p._light("background"),
    "Noisy Image": lambda p: p._noisy(),
}
