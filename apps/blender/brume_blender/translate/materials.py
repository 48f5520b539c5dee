"""Surface shaders as brume's materials: diffuse, coated, metal, glass, light that they emit, and alpha for what is transparent.
Mixtures of diffuse and translucent parts are one surface; of others the part that weighs most is taken. What is left out is
said."""

from dataclasses import dataclass, field

import bpy
import numpy as np

from .node_values import UnknownNode, Values
from .nodes import as_the_camera_sees, output_of, tree_of
from .pictures import is_cut
from .shares import Blend, Rest, Share

DIMMED_SINCE = (4, 0, 0)  # Principled's gloss takes from its base what it reflects, and that is Lambert's
LEAST = 1e-3  # what weighs less, or emits less, is nothing


@dataclass
class Bsdf:
    """One way of scattering, and its share in a shader."""

    material: str
    weight: float
    colour: object  # a plug, three numbers, or a Blend
    roughness: float = 0.0
    ior: float = 1.5
    fresnel: bool = True  # metals reflect all at grazing angles, glass reflects without a tint
    tint: object = None  # of what a coat reflects
    gain: float = 1.0  # on its colour
    told: list = field(default_factory=list)  # what was taken instead
    share: Share = Share()
    through: object = None  # Blend of the part of `colour` that leaves on the other side


@dataclass
class Surface:
    """A brume material. The colour is a plug where nodes compute it, by a texture perhaps."""

    bsdf: Bsdf
    radiance: np.ndarray
    holdout: bool = False
    invisible: bool = False
    alpha: object = None  # Rest; None: it is opaque
    glow: object = None  # Blend, where its radiance varies; that is the mean then


def surface_of(material, pictures, notes):
    """@param material  None: Blender's default"""
    if material is None:
        return Surface(Bsdf("diffuse", 1, [0.8] * 3), np.zeros(3))
    if tree_of(material) is None:
        return Surface(Bsdf("diffuse", 1, list(material.diffuse_color[:3])), np.zeros(3))
    shader = output_of(material.node_tree, "Surface")
    if output_of(material.node_tree, "Displacement") is not None:
        notes.say(material.name, "the material's displacement is left out")
    if shader is None:
        return Surface(None, np.zeros(3), invisible=output_of(material.node_tree, "Volume") is not None)
    return _Shader(material.name, pictures, notes).resolve(shader)


class _Shader:
    def __init__(self, name, pictures, notes):
        self._name, self._pictures, self._notes = name, pictures, notes
        self._bsdfs, self._radiance = [], np.zeros(3)
        self._holdout = self._transparent = 0.0
        self._unsure = []  # what was taken for numbers that vary, which matters where a part is taken alone
        self._clear = []  # (Share, colour, 1) of transparent parts
        self._lit = []  # (Share, colour, 1) of what emits

    def resolve(self, plug):
        self._collect(plug, 1.0, Share())
        if LEAST < self._holdout < 1 - LEAST:
            self._say(f"is a holdout by {self._holdout:.2g}: from a half on all of it is one; below that it is dimmed, and leaves no hole in alpha")
        if self._holdout >= 0.5:
            return Surface(None, np.zeros(3), holdout=True)
        bsdfs = sorted((b for b in self._bsdfs if b.weight > LEAST), key=lambda b: -b.weight)
        glows = self._radiance.max() > LEAST
        alpha = Rest(self._clear) if self._transparent > LEAST else None
        if alpha is not None and (bsdfs or glows) and self._transparent > 1 - LEAST:
            self._say("adds light to all that it lets through; its transparent part is left out")
            alpha = None
        radiance, glow = self._glow(alpha) if glows else (np.zeros(3), None)
        if not bsdfs:
            if alpha is not None and not glows and not self._absorbs(alpha):
                return Surface(None, np.zeros(3), invisible=True)
            return Surface(Bsdf("diffuse", 1, [0.0] * 3), radiance, alpha=alpha, glow=glow)
        best = self._diffused(bsdfs, alpha) or bsdfs[0]
        left = [f"{b.material} ({b.weight:.2g})" for b in bsdfs[1:] if best in bsdfs]
        if left:
            for told in self._unsure:
                self._say(told)
            self._say(f"is a mixture; its {best.material} part ({best.weight:.2g}) is taken alone, without {', '.join(left)}")
        for told in best.told:
            self._say(told)
        return Surface(best, radiance, alpha=alpha, glow=glow)

    def _glow(self, alpha):
        """(radiance, Blend of one that varies or None)"""
        glow = Blend(self._lit, alpha)
        try:
            radiance = np.asarray(glow.of(Values(self._rays)))
            if radiance.ndim == 1:
                return np.maximum(radiance, 0), None
        except UnknownNode:
            pass
        return self._radiance, glow

    def _absorbs(self, alpha):
        """Whether a surface that scatters nothing is seen: not all of it is clear."""
        try:
            return bool(np.any(alpha.of(Values(self._leaf)) > LEAST))
        except UnknownNode:
            return True

    def _diffused(self, bsdfs, alpha):
        """Diffuse and translucent parts as one; None: there are others, or one alone that is diffuse."""
        through = [b for b in bsdfs if b.material == "translucent"]
        alone = len(bsdfs) == 1 and not through and abs(bsdfs[0].weight + self._transparent - 1) < LEAST
        if alone or any(b.material not in ("diffuse", "translucent") for b in bsdfs):
            return None
        sums = Blend([(b.share, b.colour, b.gain) for b in bsdfs], alpha)
        passed = Blend([(b.share, b.colour, 1) for b in through], alpha) if through else None
        return Bsdf("diffuse", 1, sums, told=[told for b in bsdfs for told in b.told], through=passed)

    def _say(self, text):
        self._notes.say(self._name, "the material " + text)

    def _collect(self, plug, weight, share):
        if not plug.socket.is_output or weight <= 0:
            return
        node = plug.node
        if node.type == "ADD_SHADER":
            for part in plug.inputs():
                self._collect(part.resolve(), weight, share)
        elif node.type == "MIX_SHADER":
            factor = plug.input("Fac", "Factor")
            mean = min(max(self.number(factor, self._unsure.append), 0), 1)
            for part, own, meant in zip(plug.inputs()[1:], (1 - mean, mean), (Share.REST, Share.SHARE)):
                self._collect(part.resolve(), weight * own, share.times(factor, meant))
        elif node.type in _SHADERS:
            self._say_normals(plug)
            self._share = share
            _SHADERS[node.type](self, plug, weight)
        else:
            self._lacks(plug, weight, share)

    def _leaf(self, plug):
        """What is known of nodes without a point: texels all over an image; rays are the camera's, and they see the front."""
        node = plug.node
        seen = self._rays(plug)
        if seen is not None:
            return seen
        if node.type != "TEX_IMAGE" or node.image is None:
            return None
        picture = self._pictures.of(node.image)
        if plug.socket.name == "Alpha":
            return picture.alpha_at(*picture.some())
        picture.say_what_it_is(self._notes, self._name)
        return picture.at(*picture.some(), is_cut(node, picture))

    def number(self, plug, say=None):
        """A number that is the same all over a surface. @param say  function of what was taken instead; says it unless given"""
        say = say or self._say
        try:
            value = np.asarray(Values(self._leaf).number(plug))
            if value.ndim == 0:
                return float(value)
        except (UnknownNode, ValueError) as unknown:
            default = getattr(plug.socket, "default_value", 0.0)
            say(f"has '{plug.socket.name}' from {unknown}; its value without, {default:.4g}, is taken")
            return float(default)
        say(f"has '{plug.socket.name}' from an image; its mean, {value.mean():.4g}, is taken")
        return float(value.mean())

    def _say_normals(self, plug):
        for socket in plug.node.inputs:
            if socket.type == "VECTOR" and socket.is_linked and "Normal" in socket.name:
                self._say("has bumps, which are left out")

    def _lacks(self, plug, weight, share):
        colours = [p for p in plug.inputs() if p.socket.type == "RGBA"]
        bsdf = Bsdf("diffuse", weight, colours[0] if colours else [0.8] * 3, share=share)
        bsdf.told.append(f"has {plug.node.bl_label}, which brume lacks; a diffuse surface is taken")
        self._bsdfs.append(bsdf)

    def _translucent(self, plug, weight):
        self._bsdfs.append(Bsdf("translucent", weight, plug.input("Color"), share=self._share))

    def _diffuse(self, plug, weight):
        bsdf = Bsdf("diffuse", weight, plug.input("Color"), share=self._share)
        roughness = self.number(plug.input("Roughness"))
        if roughness > LEAST:
            bsdf.told.append(f"has a diffuse roughness of {roughness:.3g}; it is taken as 0")
        self._bsdfs.append(bsdf)

    def _glossy(self, plug, weight):
        node = plug.node
        # A Glossy BSDF reflects its colour at all angles.
        bsdf = Bsdf("conductor", weight, plug.input("Color"), self.number(plug.input("Roughness")), fresnel=False)
        if node.distribution == "SHARP":
            bsdf.roughness = 0.0
        elif node.distribution not in ("GGX",) and bsdf.roughness > LEAST:
            bsdf.told.append(f"has a distribution {node.distribution}; single scattering of GGX is taken")
        # A node of its own before Blender 4, then an input of Glossy BSDF.
        if any(p.socket.name == "Anisotropy" and abs(self.number(p)) > LEAST for p in plug.inputs()):
            bsdf.told.append("is anisotropic, which is left out")
        self._bsdfs.append(bsdf)

    def _glass(self, plug, weight):
        node = plug.node
        roughness, ior = self.number(plug.input("Roughness")), self.number(plug.input("IOR"))
        # Its colour tints reflections, too.
        bsdf = Bsdf("dielectric", weight, plug.input("Color"), roughness, ior, fresnel=False)
        if getattr(node, "distribution", "GGX") == "SHARP":
            bsdf.roughness = 0.0
        elif node.distribution not in ("GGX",) and bsdf.roughness > LEAST:
            bsdf.told.append(f"has a distribution {node.distribution}; single scattering of GGX is taken")
        if node.type == "BSDF_REFRACTION":
            bsdf.told.append("refracts without reflecting; glass is taken, which does both")
        self._bsdfs.append(bsdf)

    def _emission(self, plug, weight):
        self._emit(plug.input("Color"), plug.input("Strength"), weight)

    def _emit(self, colour, strength, weight):
        self._lit.append((self._share.times(strength, Share.NUMBER), colour, 1))
        number = self.number(strength, self._unsure.append)
        if number <= 0 and strength.resolve().socket.is_output:
            number = 1.0  # it may be more somewhere
        values = Values(self._mean_of_image, lambda p, _: 0.5 if p.socket.type == "VALUE" else np.full(3, 0.5))
        mean = np.atleast_2d(values.colour(colour)).mean(0)
        self._radiance = self._radiance + max(weight * number, 0) * np.maximum(mean, 0)

    def _rays(self, plug):
        return as_the_camera_sees(plug, self._say)

    def _mean_of_image(self, plug):
        value = self._leaf(plug)
        return value.mean(0) if value is not None and plug.node.type == "TEX_IMAGE" else value

    def _transparency(self, plug, weight):
        self._transparent += weight
        self._clear.append((self._share, plug.input("Color"), 1))
        try:
            if np.ptp(np.asarray(Values(self._leaf).colour(plug.input("Color"))), axis=-1).max() > LEAST:
                self._say("lets coloured light through, which is grey here")
        except UnknownNode:
            pass  # what it is made of is said where it is computed

    def _hold(self, plug, weight):
        self._holdout += weight

    def _principled(self, plug, weight):
        metallic = min(max(self.number(plug.input("Metallic")), 0), 1)
        glass = min(max(self.number(plug.input("Transmission", "Transmission Weight")), 0), 1) * (1 - metallic)
        alpha = self.number(plug.input("Alpha"), self._unsure.append)
        if alpha < 1 - LEAST:
            self._transparent += weight * (1 - alpha)
            self._clear.append((self._share.times(plug.input("Alpha"), Share.REST), [1.0] * 3, 1))
            self._share = self._share.times(plug.input("Alpha"))
            weight *= alpha
        colour, roughness = plug.input("Base Color"), self.number(plug.input("Roughness"))
        self._bsdfs.append(Bsdf("conductor", weight * metallic, colour, roughness))
        self._bsdfs.append(Bsdf("dielectric", weight * glass, colour, roughness, self.number(plug.input("IOR"))))
        self._bsdfs.append(self._coated(plug, weight * (1 - metallic) * (1 - glass), colour, roughness))
        for names in (("Subsurface", "Subsurface Weight"), ("Sheen", "Sheen Weight"), ("Clearcoat", "Coat Weight"), ("Anisotropic",)):
            if self.number(plug.input(*names)) > LEAST:
                self._say(f"has {names[0].lower()}, which is left out")
        distribution = getattr(plug.node, "distribution", "GGX")
        if distribution != "GGX" and roughness > LEAST and max(metallic, glass) > LEAST:
            self._say(f"has a distribution {distribution}; single scattering of GGX is taken")
        if glass > LEAST and any(p.socket.name == "Transmission Roughness" and self.number(p) > LEAST for p in plug.inputs()):
            self._say("has a roughness of transmission of its own, which is left out")
        self._emit(plug.input("Emission", "Emission Color"), plug.input("Emission Strength"), weight)


    def _coated(self, plug, weight, colour, roughness):
        """What of a Principled shader is neither metal nor glass: its base under its gloss."""
        level = max(self.number(plug.input("Specular", "Specular IOR Level")), 0)
        names = [p.socket.name for p in plug.inputs()]
        head_on = 0.08 * level  # Cycles' reflectance before Blender 4, whatever the index
        if "Specular IOR Level" in names:
            ior = max(self.number(plug.input("IOR")), 1)
            head_on = 2 * level * ((ior - 1) / (ior + 1)) ** 2
        root = min(head_on, 0.36) ** 0.5
        coated = Bsdf("coated", weight, colour, roughness, (1 + root) / (1 - root), share=self._share)
        if root < LEAST:
            coated.material = "diffuse"
        if bpy.app.version < DIMMED_SINCE:
            coated.gain = _burley_albedo(roughness) / (1 - _coat_albedo(max(roughness, 0.03) ** 2, coated.ior))
        tint = plug.input("Specular Tint") if "Specular Tint" in names else None
        if tint is not None and tint.socket.type == "RGBA":
            try:
                coated.tint = np.clip(np.asarray(Values().colour(tint)).reshape(3), 0, 1)
            except (UnknownNode, ValueError):
                coated.told.append("has a specular tint by a texture, which is left out")
        elif tint is not None and self.number(tint) > LEAST:
            coated.told.append("has a specular tint, which is left out")
        return coated


def _burley_albedo(roughness):
    """What Burley's diffuse surface reflects of light from all around."""
    mu_o, mu_i, turn = np.meshgrid(*[(np.arange(32) + 0.5) / 32] * 3, indexing="ij")
    cosine = mu_o * mu_i + np.sqrt((1 - mu_o**2) * (1 - mu_i**2)) * np.cos(np.pi * turn)
    retro = roughness * (1 + cosine) - 0.5
    values = (1 + retro * (1 - mu_o) ** 5) * (1 + retro * (1 - mu_i) ** 5)
    return float(np.average(values, weights=mu_o * mu_i))


def _coat_albedo(alpha, ior):
    """What single scattering at a rough dielectric reflects of light from all around (render/world/bsdf.cpp, CoatAlbedo)."""
    mu, u, v = np.meshgrid((np.arange(24) + 0.5) / 24, (np.arange(16) + 0.5) / 16, (np.arange(16) + 0.5) / 16, indexing="ij")
    wo = np.stack([np.sqrt(1 - mu**2), 0 * mu, mu], -1)
    e = wo * [alpha, alpha, 1]
    e /= np.linalg.norm(e, axis=-1, keepdims=True)
    across = np.stack([-e[..., 1], e[..., 0], 0 * mu], -1) / np.hypot(e[..., 0], e[..., 1])[..., None]
    x, s = np.sqrt(u) * np.cos(2 * np.pi * v), 0.5 * (1 + e[..., 2])
    y = (1 - s) * np.sqrt(np.maximum(1 - x**2, 0)) + s * np.sqrt(u) * np.sin(2 * np.pi * v)
    z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
    m = (x[..., None] * across + y[..., None] * np.cross(e, across) + z[..., None] * e) * [alpha, alpha, 1]
    m /= np.linalg.norm(m, axis=-1, keepdims=True)
    c = np.sum(wo * m, -1)
    up = 2 * c * m[..., 2] - mu
    t = np.sqrt(1 - (1 - c**2) / ior**2)
    fresnel = 0.5 * (((ior * c - t) / (ior * c + t)) ** 2 + ((c - ior * t) / (c + ior * t)) ** 2)

    def shadowing(cosine):
        return 0.5 * (np.sqrt(1 + alpha**2 * (1 / np.maximum(cosine, 1e-6) ** 2 - 1)) - 1)

    reflected = np.where((c > 0) & (up > 0), fresnel * (1 + shadowing(mu)) / (1 + shadowing(mu) + shadowing(up)), 0)
    return float(np.average(reflected, weights=mu))


_SHADERS = {
    "BSDF_DIFFUSE": _Shader._diffuse,
    "BSDF_GLOSSY": _Shader._glossy,
    "BSDF_ANISOTROPIC": _Shader._glossy,
    "BSDF_GLASS": _Shader._glass,
    "BSDF_REFRACTION": _Shader._glass,
    "BSDF_PRINCIPLED": _Shader._principled,
    "BSDF_TRANSLUCENT": _Shader._translucent,
    "BSDF_TRANSPARENT": _Shader._transparency,
    "EMISSION": _Shader._emission,
    "HOLDOUT": _Shader._hold,
}
