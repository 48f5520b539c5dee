#include "image/display.h"

#include <OpenColorIO/OpenColorIO.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <vector>

#include "base/error.h"
#include "base/text.h"
#include "image/color_space.h"

namespace brume {
namespace ocio = OCIO_NAMESPACE;

namespace {

/// Linear Rec. 709 in configurations of ACES 1.3 and later, Blender, older ACES, OpenColorIO's own examples and Maya.
constexpr std::array kRec709Names = {"Linear Rec.709 (sRGB)",
                                     "lin_rec709_scene",
                                     "lin_rec709",
                                     "Linear Rec.709",
                                     "lin_srgb",
                                     "Utility - Linear - sRGB",
                                     "Utility - Linear - Rec.709",
                                     "scene-linear Rec.709-sRGB"};
/// A role of OpenColorIO 2: the space of the configuration that is ACES 2065-1.
constexpr const char* kAcesRole = "aces_interchange";

constexpr int kFirstWithConfigurations = 0x02020000;  // of OpenColorIO

template <class Name>
std::string names(int count, const Name& name) {
  std::vector<std::string> all;
  for (int i = 0; i < count; ++i) all.push_back(name(i));
  return all.empty() ? "none" : join(all);
}

class Chooser {
 public:
  explicit Chooser(const DisplaySetting& setting) : setting_(setting) {
    ocio::SetLoggingLevel(ocio::LOGGING_LEVEL_NONE);  // it would write to stderr by itself
    if (setting.config.starts_with("ocio://") && ocio::GetVersionHex() < kFirstWithConfigurations)
      throw InputError(fmt::format(
          "{}: OpenColorIO {} brings no configurations, as it does since 2.2; expected a file (--ocio, $OCIO)",
          setting.config, ocio::GetVersion()));
    try {
      config_ = ocio::Config::CreateFromFile(setting.config.c_str());
      config_->validate();
    } catch (const ocio::Exception& error) {
      throw InputError(fmt::format("{}: not an OpenColorIO configuration that OpenColorIO {} reads: {} (--ocio, $OCIO)",
                                   setting.config, ocio::GetVersion(), error.what()));
    }
  }

  const ocio::ConstConfigRcPtr& config() const { return config_; }

  std::string display() const {
    const std::string chosen = setting_.display.empty() ? config_->getDefaultDisplay() : setting_.display;
    for (int i = 0; i < config_->getNumDisplaysAll(); ++i)
      if (lower(config_->getDisplayAll(i)) == lower(chosen)) return config_->getDisplayAll(i);
    throw InputError(
        fmt::format("{}: has no display '{}'; it has: {} (--display)", setting_.config, chosen,
                    names(config_->getNumDisplaysAll(), [&](int i) { return config_->getDisplayAll(i); })));
  }

  std::string view(const std::string& display) const {
    const std::string chosen = setting_.view.empty() ? config_->getDefaultView(display.c_str()) : setting_.view;
    const int count = config_->getNumViews(display.c_str());
    for (int i = 0; i < count; ++i)
      if (const char* const name = config_->getView(display.c_str(), i); lower(name) == lower(chosen)) return name;
    throw InputError(fmt::format("{}: the display '{}' has no view '{}'; it has: {} (--view)", setting_.config, display,
                                 chosen, names(count, [&](int i) { return config_->getView(display.c_str(), i); })));
  }

  void check_look() const {
    for (std::string look : split(setting_.look, ',')) {
      if (look.empty()) continue;
      if (look[0] == '+' || look[0] == '-') look.erase(0, 1);
      if (!config_->getLook(look.c_str()))
        throw InputError(
            fmt::format("{}: has no look '{}'; it has: {} (--look)", setting_.config, look,
                        names(config_->getNumLooks(), [&](int i) { return config_->getLookNameByIndex(i); })));
    }
  }

  /// The configuration's name of linear Rec. 709; empty where ACES 2065-1 is the way.
  std::string space() const {
    if (!setting_.space.empty()) {
      if (const auto found = config_->getColorSpace(setting_.space.c_str())) return found->getName();
      throw InputError(fmt::format(
          "{}: has no colour space '{}'; it has: {} (--ocio-space)", setting_.config, setting_.space,
          names(config_->getNumColorSpaces(), [&](int i) { return config_->getColorSpaceNameByIndex(i); })));
    }
    for (const char* const name : kRec709Names)
      if (const auto found = config_->getColorSpace(name)) return found->getName();
    if (config_->hasRole(kAcesRole)) return "";
    throw InputError(fmt::format(
        "{}: none of its colour spaces has a name that stands for linear Rec. 709, and it lacks the role {}; say which "
        "it is (--ocio-space): {}",
        setting_.config, kAcesRole,
        names(config_->getNumColorSpaces(), [&](int i) { return config_->getColorSpaceNameByIndex(i); })));
  }

 private:
  const DisplaySetting& setting_;
  ocio::ConstConfigRcPtr config_;
};

/// Adds the step from linear Rec. 709 to ACES 2065-1.
void append_aces_from_rec709(ocio::GroupTransform& steps) {
  const dmat3 matrix = glm::inverse(*rec709_from(kAces, "ACES 2065-1"));
  std::array<double, 16> rows{};
  for (int row = 0; row < 3; ++row)
    for (int column = 0; column < 3; ++column) rows[static_cast<size_t>(4 * row + column)] = matrix[column][row];
  rows[15] = 1;
  const ocio::MatrixTransformRcPtr step = ocio::MatrixTransform::Create();
  step->setMatrix(rows.data());
  steps.appendTransform(step);
}

}  // namespace

struct Display::Impl {
  DisplaySetting setting;
  ocio::ConstCPUProcessorRcPtr processor;
};

Display::Display(DisplaySetting setting) : impl_(std::make_unique<Impl>()) {
  impl_->setting = std::move(setting);
  DisplaySetting& chosen = impl_->setting;
  const Chooser choose(chosen);
  chosen.display = choose.display();
  chosen.view = choose.view(chosen.display);
  chosen.space = choose.space();
  choose.check_look();
  try {
    const ocio::GroupTransformRcPtr steps = ocio::GroupTransform::Create();
    const std::string from = chosen.space.empty() ? kAcesRole : chosen.space;
    if (chosen.space.empty()) append_aces_from_rec709(*steps);
    if (!chosen.look.empty()) {
      const ocio::LookTransformRcPtr look = ocio::LookTransform::Create();
      look->setSrc(from.c_str());
      look->setDst(from.c_str());
      look->setLooks(chosen.look.c_str());
      steps->appendTransform(look);
    }
    const ocio::DisplayViewTransformRcPtr view = ocio::DisplayViewTransform::Create();
    view->setSrc(from.c_str());
    view->setDisplay(chosen.display.c_str());
    view->setView(chosen.view.c_str());
    view->setLooksBypass(!chosen.look.empty());
    steps->appendTransform(view);
    impl_->processor = choose.config()->getProcessor(steps)->getDefaultCPUProcessor();
  } catch (const ocio::Exception& error) {
    throw InputError(fmt::format("{}: the view '{}' of the display '{}' does not work: {}", chosen.config, chosen.view,
                                 chosen.display, error.what()));
  }
}

Display::~Display() = default;
Display::Display(Display&&) noexcept = default;

const DisplaySetting& Display::setting() const {
  return impl_->setting;
}

void Display::apply(std::span<float> rgb) const {
  ocio::PackedImageDesc picture(rgb.data(), static_cast<long>(rgb.size() / 3), 1, 3);
  impl_->processor->apply(picture);
  for (float& v : rgb) v = std::clamp(v, 0.0f, 1.0f);
}

}  // namespace brume
