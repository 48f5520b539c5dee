#pragma once
#include <string>
#include <vector>

#include "image/layers.h"

namespace brume {

/// What one path tells about its pixel. Every member is an unbiased sample of an expectation.
struct PathSample {
  dvec3 beauty{0};  ///< direct + indirect
  dvec3 direct{0}, indirect{0};
  dvec3 background{0}, emission{0}, single{0}, surface{0};             ///< parts of direct
  dvec3 surface_emission{0}, volume_indirect{0}, surface_indirect{0};  ///< parts of surface; of indirect
  dvec3 gradient{0}, gradient_first_scatter{0}, gradient_transmittance_weighted{0};
  dvec3 transmittance{0};
  double coverage = 0;
  double scatter_depth = 0, scatter_density = 0, scatter_share = 0, optical_depth = 0;
  dvec3 scatter_position{0}, albedo{0};
  dvec3 surface_albedo{0}, normal{0}, position{0};
  double surface_share = 0, depth = 0;
  dvec3 flash{0}, catcher{0}, catcher_unshadowed{0};
  double transmitted = 0;  ///< mean of the transmittance's channels: what alpha is short of 1
  /// Where there are light groups, three of each: all of its light, direct, indirect. Valid until the sink returns.
  const dvec3* groups = nullptr;

  const double* values() const { return &beauty.x; }
  double* values() { return &beauty.x; }
};

/// A layer that a render can record, and where a PathSample keeps it.
struct RecordedLayer {
  LayerName name;
  size_t offset;  ///< in doubles from the start of a PathSample
};

/// All of them but the beauty and alpha, which every frame has.
const std::vector<RecordedLayer>& recordable_layers();

/// Which layers a render records, and with which statistics.
struct LayerRequest {
  std::vector<std::string> names = {"direct", "indirect", "gradient", "coverage", "transmittance"};
  bool statistics = true;                      ///< mean_variance, half_a, half_b of each
  bool buckets = false;                        ///< and eight bucket means
  bool guides = false;                         ///< and the noise-free layers of render/guides
  bool depths = false;                         ///< and those of what is seen, and mist (image/deep_picture.h)
  bool motion = false;                         ///< and how what is seen moves (workflows/motion.h)
  bool matte_objects = false;                  ///< and Cryptomatte of objects (image/cryptomatte.h)
  bool matte_materials = false;                ///< and of materials
  bool light_parts = false;                    ///< and direct and indirect light of each light group
  std::vector<std::string> light_groups = {};  ///< the scene's: their light is recorded wherever there are any
  bool records = false;                        ///< keep what happened to each path, for RenderJob::records

  /// Names as in the EXR; the beauty and the counts always come. "guides" is all of them, "depths" those of what
  /// is seen and mist, "motion" how it moves, "cryptomatte" both of its layers, "light_parts" the direct and indirect
  /// light of light groups, "all" every layer.
  /// @throws InputError for a name brume does not record
  static LayerRequest of(const std::vector<std::string>& names, bool statistics, bool buckets = false);
  bool has(const LayerName& layer) const;
  bool mattes() const { return matte_objects || matte_materials; }
  /// Of light groups: "light.key", "light.key.direct"; each R, G, B.
  struct GroupLayer {
    std::string name;
    size_t offset;  ///< in doubles from PathSample::groups
  };
  std::vector<GroupLayer> group_layers() const;
  /// As of() takes them.
  std::vector<std::string> text() const;
};

}  // namespace brume
