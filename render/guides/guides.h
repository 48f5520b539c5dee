#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "image/layers.h"
#include "render/guides/deep_pixels.h"
#include "render/guides/guide_media.h"
#include "render/guides/light_fields.h"
#include "render/transport/integrator.h"
#include "render/world/camera.h"

namespace brume {

/// What a camera ray can know about the light without a random number, as layers "guide.*" for filters: opacity, depth,
/// gradient, single scattering of each light, a coarse solution of multiple scattering, emission, surfaces. Biased, but
/// without noise. Every value is an integral along the ray, weighted by what the eye sees of each piece of it, so that
/// it falls to 0 where the medium ends. docs/guides.md lists them.
///
/// The light inside the media is solved when the object is made, and serves any camera and any number of frames; of
/// large chromatic media that of green and blue is solved for each frame, so that it is never held for all three.
class Guides {
 public:
  /// @param context  media, emissions, lights and surfaces, which must outlive the object
  /// @param samples  of each pixel of the pictures that they will serve: the more there are, the less their noise hides
  ///                 what the guides do not know, and the closer together lie the nodes at which light is solved
  /// @param pixels   of the whole picture: small ones show nothing of what many nodes would know
  /// @param step     of the marches [voxels], where the medium is still transparent
  Guides(const PathContext& context, int samples, double pixels, const Task& task = {}, double step = 0.7);

  /// How many times closer than for the fewest: 1 below 8 samples, and a third of an octave more for four times as
  /// many; half as close for none, a sketch to look at while better guides are made.
  static double detail(int samples);
  /// Nodes, at most, that the light of pictures of so many pixels is solved at where there is no more detail: what
  /// `pixels` decides.
  static double most_nodes(double pixels) { return LightFields::most_nodes(pixels); }

  /// Marches the pixels of a window of the picture and adds the layers to `frame`, which has the window's size.
  /// @param corner  of the window, in pixels of the whole picture
  /// @param sketch  one ray for each pixel, in longer steps: for pictures that are looked at while better ones are made
  /// @param deep    takes what is seen at which depth of the same window; null: that is not kept
  void record(const Camera& camera, const ivec2& corner, Layers& frame, const Task& task, bool sketch = false,
              DeepRecord* deep = nullptr) const;
  /// The same of a whole picture for who watches it come: its tiles from the middle outwards.
  /// @param done  told of the pixels from..to that are there, from any thread, one at a time
  void record_watched(const Camera& camera, Layers& frame, const Task& task,
                      const std::function<void(const ivec2& from, const ivec2& to)>& done) const;
  /// The same, but that channels go to Layers::stored where `stored` says so: at no time are they all there as planes.
  void record_stored(const Camera& camera, const ivec2& corner, Layers& frame, const Task& task,
                     const std::function<bool(const std::string& channel)>& stored, DeepRecord* deep = nullptr) const;

  /// Memory and time that it took, in one line.
  std::string explain() const;
  /// What of this scene they do not know, or only roughly.
  std::vector<std::string> left_out() const;
  size_t bytes() const;

 private:
  /// Calls visit(march) for each colour.
  template <class Visit>
  void for_each_march(const Camera& camera, bool sketch, const Task& task, const Visit& visit) const;
  LightFields solved(GuideColour colour, const Task& task) const;
  /// The deep pixels of a scene without media; of surfaces it is not known what they reflect.
  void record_surfaces(const Camera& camera, const ivec2& corner, const ivec2& size, DeepRecord& deep,
                       const Task& task) const;

  const PathContext context_;
  std::vector<GuideMedia> media_;     // one for each time of the shutter that rays are marched at
  std::vector<GuideColour> colours_;  // grey alone, or red, green and blue
  std::vector<LightFields> fields_;   // for each colour, or for the first where all would take much memory
  int samples_ = 1;
  double pixels_ = 0, step_, seconds_ = 0;
};

}  // namespace brume
