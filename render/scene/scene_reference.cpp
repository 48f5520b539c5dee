#include "render/scene/scene_reference.h"

#include "render/scene/field_reference.h"

namespace brume {

std::string scene_reference() {
  FieldReference reference;
  reference.text =
      "# Scenes\n\n"
      "A scene is a TOML file. Paths in it start at its own folder. Unknown keys are errors. Any key can be set from the\n"
      "command line: `-D camera.fov=30`, `-D volumes.0.sigma_t=5`; paths given so start at the scene's folder too. Colours are linear RGB of `film.color_space`, Rec. 709 without one: `[r, g, b]` or one grey\n"
      "number. Lengths are in scene units, whichever the volumes use. Pictures in other colour spaces are converted, and numbers in files that are not usable (NaN, negative light) are\n"
      "repaired and told: [methods.md](methods.md#numbers-that-are-not-usable).\n\n"
      "A sequence is one scene: `brume render shot.toml --frames 1-240 -o 'shot.####.exr'` sets `render.frame` for each\n"
      "frame. Names of files may hold its number, as `smoke.####.vdb`, `smoke.$F4.vdb` or `smoke.%04d.vdb` (a file that\n"
      "has that very name is taken as it is), and `camera.keys` move the camera. A camera with roll or zoom comes from\n"
      "`from_exr = \"camera.####.exr\"`, whatever else changes from one scene file per frame: `brume render\n"
      "'shot.####.toml' --frames 1-240`.\n\n"
      "An OpenVDB or NanoVDB file may stand in the place of a scene, or a sequence of them (`brume render smoke.vdb`, `brume view\n"
      "'smoke.####.vdb'`). What is said with `-D` is taken, and the rest is guessed to go with it and told: the camera\n"
      "frames what is seen of the density in a picture of that shape, voxels astray or too faint to be seen left out;\n"
      "`sigma_t` gives an optical depth of 12, or 4 where it burns. It burns where it holds flames, a temperature above\n"
      "100, taken as kelvin, or any temperature beside flames or fuel; a grid of flames that is empty means that nothing\n"
      "burns. A sequence has one camera, one extinction and one scale of its fire, by the frames that reach farthest and\n"
      "burn most, and the density grid of most frames. `--save-scene` writes it all down.\n\n"
      "This page is written by `brume docs scene`; a test keeps it in step with the parser.\n";
  reference.table("[camera]", "Box filter of one pixel, row 0 on top.", CameraSettings{});
  reference.table("[film]", "The picture.", FilmSettings{});
  reference.table("[render]",
                  "The estimator. No setting here but max_events and indirect_limit changes the expected picture.",
                  RenderSettings{});
  reference.table("[environment]", "Light from infinitely far away.", EnvironmentSettings{});
  reference.table(
      "[[volumes]]",
      "A fog volume and its coefficients: sigma_t(x) = sigma_t * density(x), sigma_s = albedo * sigma_t. Several may overlap. `file` is required where shape is grid.",
      VolumeSettings{});
  reference.table(
      "[volumes.time]",
      "Of a volume whose file is a sequence ([sequences.md](sequences.md#volumes-at-their-own-speed)). Without it the volume's frame is the scene's.",
      VolumeTime{});
  reference.table(
      "[volumes.detail]",
      "Noise below the voxels of a grid ([methods.md](methods.md#detail-below-the-voxel)). The mean of the density stays. With `velocity_grid` it follows the flow from frame to frame.",
      VolumeDetail{});
  reference.table(
      "[[instances]]",
      "Places where a volume stands. One that is named here stands at these places only, not at its own; its grids are held once, however many there are ([instances.md](instances.md)). One of `matrices` and `file` is required.",
      InstanceSettings{});
  reference.table("[[lights]]", "Lights of finite size or parallel light.", LightSettings{});
  reference.table("[[surfaces]]", "Solid things.", SurfaceSettings{});
  return reference.text;
}

}  // namespace brume
