#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "image/layers.h"
#include "workflows/host.h"
#include "workflows/view/messages.h"

namespace brume {

struct ViewOptions {
  std::filesystem::path scene;  ///< scene, OpenVDB file, or frame (is_frame_file); a pattern where there are frames
  std::vector<int> frames = {};
  std::vector<std::string> overrides = {};
  std::string clean_filter = "transport_regression";
  std::filesystem::path map = {};  ///< of frames of other renderers (workflows/open_frame.h); empty: recognised
};

/// Answers looks, the newest first, from a thread of its own: at a scene (Viewer), or at frames that are there
/// (FrameViewer).
class ViewSource {
 public:
  virtual ~ViewSource() = default;

  /// Takes the place of all looks before.
  virtual void look(ViewLook look) = 0;
  virtual void probe(const ViewProbe& probe) = 0;
  /// Ends what is being computed; the next look goes on.
  virtual void pause() = 0;
  /// Looks again if a file that was read has changed; tells where one is gone. To be called now and then.
  virtual void check_files() = 0;

  /// What there is to keep of what was shown last; null: nothing yet.
  virtual std::shared_ptr<const Layers> frame() const = 0;
  /// The frame of this very look, lights mixed; null where it is not there yet.
  /// @throws InputError for a light group that there is not
  virtual std::shared_ptr<const Layers> frame(const ViewLook& look) const = 0;
  /// The scene as it was looked at last, as a file of its own; empty before. Of frames the mix, for `brume mix --mix`.
  virtual std::string scene_text() const = 0;
  /// The same of a look that need not have been answered. @throws InputError
  virtual std::string scene_text(const ViewLook& look) const = 0;
  /// What makes the look's picture, for a shell; of frames that of the file, mixed, whichever layer is looked at.
  virtual std::string command(const ViewLook& look) const = 0;
  /// What makes the lights of the look's scene as it mixes them. @throws InputError, of frames always
  virtual std::vector<std::string> mix_assignments(const ViewLook& look) const = 0;
};

/// Whether a file is looked at as a frame, by its name's ending.
bool is_frame_file(const std::filesystem::path& path);

/// For those who can tell their user at once what a page would only show. @throws InputError: a file that is missing; a
/// scene that cannot be read, overrides included; a frame in which nothing can be shown; options of the other kind
void check_viewable(const ViewOptions& options);

/// @throws InputError: a filter that cannot clean renders
std::unique_ptr<ViewSource> make_view_source(const ViewOptions& options, const Host& host, ViewListener& listener);

}  // namespace brume
