#pragma once
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "image/cryptomatte.h"
#include "image/exr_io.h"
#include "workflows/frame_lights.h"
#include "workflows/view/messages.h"

namespace brume {

/// A frame in a file, of whichever program, as it is looked at: every layer of one or three channels and every matte
/// that it holds. Channels are read when a layer is shown that needs them, and kept as small as they are shown.
class ViewedFrame {
 public:
  /// Reads the header. @param map  as FileOptions::map
  /// @throws InputError: missing, damaged, deep; nothing in it can be shown; as read_map
  ViewedFrame(const std::filesystem::path& path, const std::filesystem::path& map);

  const std::vector<ViewSceneText::Layer>& layers() const { return told_; }
  /// That can be mixed.
  std::vector<std::string> light_groups() const;
  /// What a user should know of the file.
  const std::vector<std::string>& notes() const { return notes_; }

  /// A layer, lights mixed, with neither number nor frame; nothing where there is none of that name.
  /// @param room  in which it is shown: it is made smaller by a whole factor where more pixels would not be seen
  /// @throws InputError: truncated or damaged
  std::optional<ViewPicture> picture(const std::string& layer, const LightMix& mix, const ivec2& room);

 private:
  struct Entry {
    ViewSceneText::Layer told = {};
    std::vector<std::string> channels = {};  // of the file; of a matte those of its ranks
    const MatteLayer* matte = nullptr;
    float id = 0;        // of the matte
    bool light = false;  // of all groups together: a mix cannot tell what it would be
  };

  void list_picture();
  void list_lights();
  void list_mattes();
  void list_channels();
  void list(Entry entry);
  void read(const std::set<std::string>& channels, bool depth);
  const Plane& plane(const std::string& name) const { return planes_.at(name); }
  std::vector<Plane> planes_of(const Entry& entry, const LightMix& mix, bool& misses_mix) const;

  ExrFile file_;
  std::optional<ForeignFrame> foreign_;
  std::vector<FrameLights> lights_;
  std::vector<MatteLayer> mattes_;
  std::map<std::string, Entry> entries_;
  std::vector<ViewSceneText::Layer> told_;
  std::vector<std::string> notes_;
  std::set<std::string> listed_;  // channels
  int step_ = 1;                  // pixels of the file along each side of one that is shown
  std::map<std::string, Plane> planes_;
};

}  // namespace brume
