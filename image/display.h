#pragma once
#include <memory>
#include <span>
#include <string>

namespace brume {

/// Which display of an OpenColorIO configuration shows a picture. What is empty is the configuration's own default.
struct DisplaySetting {
  std::string config = {};   ///< a file, "ocio://NAME" for one that the library brings; empty: none
  std::string display = {};  ///< a screen: "sRGB"
  std::string view = {};     ///< how light becomes its colours: "Filmic"
  std::string look = {};     ///< replaces the view's looks; several stand behind one another with commas
  std::string space = {};    ///< the configuration's name of linear Rec. 709, where it is not found by itself

  bool operator==(const DisplaySetting&) const = default;
};

/// What turns linear light into what a screen is sent, as an OpenColorIO configuration says.
class Display {
 public:
  /// Linear Rec. 709 is the configuration's space of one of the names that are common for it, else it is reached from
  /// ACES 2065-1 by the role aces_interchange.
  /// @throws InputError: no such configuration, display, view, look or space, with those that exist; a configuration
  ///         that has no linear Rec. 709 and no way to it; files of its that are missing
  explicit Display(DisplaySetting setting);
  ~Display();
  Display(Display&&) noexcept;

  /// The setting with its defaults filled in; the space stays empty where it is reached from ACES 2065-1.
  const DisplaySetting& setting() const;

  /// RGB after RGB, linear Rec. 709, of which 0 to 1 is left afterwards. @param rgb  a multiple of three, all finite
  void apply(std::span<float> rgb) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace brume
