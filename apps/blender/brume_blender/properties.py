"""What a scene and its view layers keep for brume."""

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import passes, program
from .light_mix import BrumeLightMix
from .translate.baking import MILLIONS
from .translate.light_groups import group_names

DEFAULT_FILTER = "transport_regression"


def _search_filters(self, context, text):
    try:
        names = program.filters_of(program.find(preferred_program(context)))
    except program.NoProgram:
        names = [DEFAULT_FILTER]
    return [name for name in names if text in name]


def preferred_program(context=None):
    """Of the preferences; empty where they say nothing, or the add-on is not in them, as where a script enabled it."""
    addon = (context or bpy.context).preferences.addons.get(__package__)
    return addon.preferences.program if addon and addon.preferences else ""


class BrumePreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    program: StringProperty(
        name="Program",
        description="The program brume; empty: the one that the add-on was built with, or the one on PATH",
        subtype="FILE_PATH",
    )

    def draw(self, context):
        self.layout.prop(self, "program")
        try:
            self.layout.label(text=f"Takes {program.find(self.program)}", icon="CHECKMARK")
        except program.NoProgram as problem:
            self.layout.label(text=str(problem), icon="ERROR")


class BrumeSceneSettings(bpy.types.PropertyGroup):
    samples: IntProperty(name="Samples", description="Paths per pixel", default=16, min=1, max=1 << 24, soft_max=1024)
    use_time: BoolProperty(name="Time", description="As many samples as fit the time, instead of a number of them")
    time: FloatProperty(
        name="Time", description="After which no new round of samples begins", default=60, min=0.1, subtype="TIME_ABSOLUTE"
    )
    use_error: BoolProperty(
        name="Target Error", description="As many samples as it takes to reach an estimated error, instead of a number of them"
    )
    error: FloatProperty(
        name="Target Error",
        description="Estimated relative error of the picture at which the render ends: root of the mean of variance / (mean^2 + 0.01 white^2)",
        default=0.005,
        min=1e-6,
        max=10,
        precision=4,
    )
    seed: IntProperty(name="Seed", description="Of the random numbers; every frame has others", min=0)
    use_fixed_seed: BoolProperty(
        name="Fixed", description="The same random numbers in every frame: what noise is left stands still"
    )
    indirect_limit: FloatProperty(
        name="Clamp Indirect",
        description="The most that one path may bring after its first scattering, as in Cycles; 0: no limit, and no bias",
        default=10,
        min=0,
    )
    viewport_samples: IntProperty(
        name="Viewport Samples",
        description="Paths per pixel in the viewport, after which it rests",
        default=256,
        min=1,
        max=1 << 20,
        soft_max=4096,
    )
    bake_millions: FloatProperty(
        name="Baked Voxels",
        description="Millions of voxels that what a volume shader's nodes compute is baked into at most, a volume",
        default=MILLIONS,
        min=0.01,
        soft_max=256,
        precision=0,
    )
    use_clean: BoolProperty(
        name="Clean",
        description="Clean the picture by what is known of the light without random numbers, while it renders and at the end",
        default=True,
    )
    filter: StringProperty(
        name="Filter",
        description="That cleans the picture",
        default=DEFAULT_FILTER,
        search=_search_filters,
        search_options={"SUGGESTION"},
    )

    animation_files: StringProperty(
        name="Frames",
        description="Files that Cycles has rendered, OpenEXR MultiLayer, with #### for the frame's number; empty: the scene's output",
        subtype="FILE_PATH",
    )
    animation_suffix: StringProperty(
        name="Suffix",
        description="Put before the number in the names of the clean files; empty: they replace the noisy ones",
        default="_clean",
    )

    def ends_by_samples(self):
        return not (self.use_time or self.use_error)


class BrumeViewLayerSettings(bpy.types.PropertyGroup):
    use_pass_volume_direct: BoolProperty(name="Volume Direct", description="Light that media scatter once")
    use_pass_volume_indirect: BoolProperty(name="Volume Indirect", description="Light that media scatter first, and more than once")
    use_pass_noisy: BoolProperty(name="Noisy Image", description="The picture before it is cleaned")
    layers: StringProperty(
        name="Layers",
        description="Further layers of brume, with commas between: "
        + ", ".join((*passes.LAYERS, *passes.GIVEN))
        + ". Each becomes a pass of its name",
    )
    use_mix: BoolProperty(
        name="Mix in the Viewport",
        description="Light groups are computed in the viewport, too, where they can be mixed without another rendering; what the mix "
        "does not need takes longer by that",
        default=True,
    )
    mix: CollectionProperty(type=BrumeLightMix)

    def extra_names(self):
        return [name for name in (part.strip() for part in self.layers.split(",")) if name]


def wanted_passes(view_layer):
    """The passes of a view layer, Combined first, and the names among its further layers that are none.

    The volume passes are those of Cycles' settings, too, so that a file set up for Cycles has them."""
    own = view_layer.brume
    cycles = getattr(view_layer, "cycles", None)
    switches = {
        "Depth": view_layer.use_pass_z,
        "Position": view_layer.use_pass_position,
        "Normal": view_layer.use_pass_normal,
        "Mist": view_layer.use_pass_mist,
        "Vector": view_layer.use_pass_vector,
        "DiffDir": view_layer.use_pass_diffuse_direct,
        "DiffInd": view_layer.use_pass_diffuse_indirect,
        "DiffCol": view_layer.use_pass_diffuse_color,
        "VolumeDir": own.use_pass_volume_direct or getattr(cycles, "use_pass_volume_direct", False),
        "VolumeInd": own.use_pass_volume_indirect or getattr(cycles, "use_pass_volume_indirect", False),
        "Emit": view_layer.use_pass_emit,
        "Env": view_layer.use_pass_environment,
        "Noisy Image": own.use_pass_noisy,
    }
    extra, unknown = passes.extra_passes(own.extra_names())
    more = passes.light_passes(group_names(view_layer)) + passes.matte_passes(*matte_settings(view_layer)) + extra
    return [passes.COMBINED] + [passes.KNOWN[name] for name, on in switches.items() if on] + more, unknown


def matte_settings(view_layer):
    """Whether a view layer wants Cryptomatte of objects, of materials, and in how many levels."""
    return view_layer.use_pass_cryptomatte_object, view_layer.use_pass_cryptomatte_material, view_layer.pass_cryptomatte_depth


# Blender's passes that brume has none of, by the end of their switch's name.
LACKING = {
    "uv": "UV", "ambient_occlusion": "AO", "shadow": "Shadow", "object_index": "IndexOB",
    "material_index": "IndexMA", "glossy_direct": "GlossDir", "glossy_indirect": "GlossInd", "glossy_color": "GlossCol",
    "transmission_direct": "TransDir", "transmission_indirect": "TransInd", "transmission_color": "TransCol",
    "subsurface_direct": "SubsurfaceDir", "subsurface_indirect": "SubsurfaceInd", "subsurface_color": "SubsurfaceCol",
    "cryptomatte_asset": "CryptoAsset",
}  # fmt: skip


# And of Cycles' own settings.
LACKING_OF_CYCLES = {
    "use_pass_shadow_catcher": "Shadow Catcher", "pass_debug_sample_count": "Debug Sample Count",
    "denoising_store_passes": "Denoising Data",
}  # fmt: skip


def lacking_passes(view_layer):
    """Names of passes that a view layer asks for and that brume lacks."""
    names = [name for switch, name in LACKING.items() if getattr(view_layer, "use_pass_" + switch, False)]
    cycles = getattr(view_layer, "cycles", None)
    names += [name for switch, name in LACKING_OF_CYCLES.items() if getattr(cycles, switch, False)]
    return names + [f"{aov.name} (AOV)" for aov in view_layer.aovs]


CLASSES = (BrumePreferences, BrumeSceneSettings, BrumeLightMix, BrumeViewLayerSettings)


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.brume = PointerProperty(type=BrumeSceneSettings)
    bpy.types.ViewLayer.brume = PointerProperty(type=BrumeViewLayerSettings)


def unregister():
    del bpy.types.ViewLayer.brume
    del bpy.types.Scene.brume
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
