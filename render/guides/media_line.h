#pragma once
#include <vector>

#include "render/guides/guide_media.h"

namespace brume {

/// The media along a straight line: made for looking them up at many points of it in order, because the line is taken
/// to each medium's own space once, and a cell that holds several points is found once.
class MediaLine {
 public:
  /// @param detailed  whether densities have their detail; solvers, whose points lie far apart, want its mean
  MediaLine(const GuideMedia& media, GuideColour colour, bool detailed = false);
  /// Looks along a world ray from now on; its direction may have any length.
  void follow(const Ray& ray);

  GuideMedia::Point at(double t) { return look_up(t, nullptr); }
  /// @param gradient  of the extinction, world space
  GuideMedia::Point at(double t, dvec3& gradient) { return look_up(t, &gradient); }

 private:
  /// A medium, and where the line was looked up last.
  struct Local {
    const Medium* medium;
    size_t number;                      ///< of it
    const BrickGrid* bricks = nullptr;  ///< null where densities are not simply its interpolated values
    const Detail* detail = nullptr;     ///< that is looked up, too
    int cell_bits = 0;
    Ray ray{};
    double begin = 0, end = 0;  ///< of the line, outside of which the medium is not
    ivec3 coordinates{-1};
    const BrickGrid::Cell* cell = nullptr;
    const Instance* instance = nullptr;  ///< of the medium
    double extinction = 0, albedo = 0;   ///< of an instance: per density; grey or of the colour
    dvec3 tint{1};
  };
  double coloured_albedo(const Local& instance, double t) const;
  Local local_of(const Medium& medium, size_t number) const;
  void add_instances(const Medium& medium, size_t number);
  static void find_extent(Local& local);
  GuideMedia::Point look_up(double t, dvec3* gradient);
  /// Density of a medium, and its gradient; local space. The gradient is left alone where there is no density.
  static double density(Local& local, double t, dvec3* gradient);

  const GuideMedia& media_;
  const GuideColour colour_;
  const bool detailed_;
  Ray ray_{};
  std::vector<Local> locals_;  // of the media without instances, then of the instances that the line meets
  size_t still_ = 0;           // the former
  bool one_ = false;           ///< one medium, the same everywhere but for its density
};

}  // namespace brume
