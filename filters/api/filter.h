#pragma once
#include <any>
#include <concepts>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/progress.h"
#include "filters/inputs/filter_frame.h"
#include "filters/inputs/samples.h"
#include "image/layers.h"

namespace brume {

namespace layer {
inline constexpr LayerName error_bound{"error_bound", "RGB", "of a filter: the error's stochastic bound"};
inline constexpr LayerName sampling_map{"sampling_map", "Y",
                                        "of a filter: samples per pixel to take next, their mean being one"};
inline constexpr LayerName noisy{"noisy", "RGB", "of a frame with a clean picture on top: the raw one"};
inline constexpr LayerName clean_direct{"clean_direct", "RGB",
                                        "of a filter that cleans the parts apart: direct, clean"};
inline constexpr LayerName clean_indirect{"clean_indirect", "RGB", "the same of indirect"};
inline constexpr LayerName clean_error{
    "clean_error", "Y", "of a filter: estimated error of its result at the pixel, root mean square over colours"};
}  // namespace layer

/// What a filter makes, and what it has to say.
struct FilterOutput {
  std::array<Plane*, 3> rgb;
  /// Where to leave the layers that the filter declared to produce, by full channel name; null: not collected.
  std::map<std::string, Plane>* products = nullptr;
  std::vector<std::string>* notes = nullptr;  ///< what the user should know; null: dropped
  RepairedPixels* repaired = nullptr;         ///< of records that were not all finite; null: not collected

  Plane* operator[](size_t c) const { return rgb[c]; }
};

/// Statistics of its signal that a filter reads beside the mean; each includes those before it.
enum class Statistics { kNone, kVariance, kHalves, kBuckets };

/// One parameter, as the command line, the documentation, the tests and the tuning see it.
struct Parameter {
  using Value = std::variant<double, std::string>;
  std::string name, unit, help;
  double lowest = 0, highest = 0;  ///< of a number
  bool integer = false;
  bool is_text = false;              ///< any text
  std::vector<std::string> choices;  ///< not empty for a choice
  std::vector<Value> candidates;     ///< what an exhaustive search tries; empty: left at its default
  std::function<Value(const std::any&)> get;
  std::function<void(std::any&, const Value&)> set;

  /// "in 0 .. 8 px" or "one of a, b".
  std::string range() const;
  static std::string text(const Value& value);
};

/// A named choice of parameters.
struct Preset {
  std::string name, summary;
  std::vector<std::pair<std::string, std::string>> settings;  ///< what differs from the defaults
};

/// "name=value,name=value". @throws InputError for a part without '='
std::vector<std::pair<std::string, std::string>> parse_assignments(std::string_view text);

/// Which of a frame's features a filter takes by itself, where the caller names none.
enum class FeatureSet {
  kAll,      ///< all but those made from guides
  kScalar,   ///< without directions
  kOpacity,  ///< opacity alone
  kGuides,   ///< those made from guides, where there are any
};
/// The features of a set (filters/inputs/features.h); empty: every feature there is.
std::vector<std::string> names_of(FeatureSet set);

/// A filter: what it is called, where it comes from, what it reads, and what it does.
struct FilterEntry {
  std::string name, summary, source, notes;
  double merit = 0;  ///< samples it is worth: squared error of path tracing over its own at defaults, docs/results.md
  std::string when;  ///< to take it rather than another, as the end of "Take it ..."
  std::vector<LayerName> needs, can_use;
  std::vector<LayerName> produces;            ///< beside the clean picture
  Statistics statistics = Statistics::kNone;  ///< that it needs
  Statistics can_use_statistics = Statistics::kNone;
  bool signal_variance = true;  ///< whether the variance is among them
  bool makes_halves = false;    ///< its defaults run as well on frames without halves
  /// Whether it weighs by features or regresses on them with these parameters, whichever the frame has; null: never.
  std::function<bool(const std::any&)> features;
  /// Which it takes where the caller names none; null: all.
  std::function<FeatureSet(const std::any&)> feature_set;
  bool needs_features = false;  ///< is of no use without any
  /// Whether it reads FilterFrame::lab_noise with these parameters; null: never.
  std::function<bool(const std::any&)> noise_level;
  bool variances = false;      ///< reads the variance of the layers it needs or can use
  bool guides = false;         ///< reads every layer `guide.*` that the frame has
  bool stored_guides = false;  ///< reads those that is_only_fitted() from Layers::stored, too
  /// Cleans `direct` and `indirect` apart where a caller asks for the beauty and the frame has both; what it produces
  /// adds up over them.
  bool parts = false;
  /// Where a signal may change: the filter runs once, on this box, and leaves the rest as it is. Null: on tiles.
  std::function<Box(const Layers&, const LayerName& signal)> box;
  enum class Records { kNo, kCanUse, kNeeds } records = Records::kNo;  ///< of what happened to each sample
  bool sequences = false;                                              ///< looks into FilterFrame::nearby
  int frame_window = 0;                                                ///< frames on either side that serve it best
  bool aligned = false;     ///< wants pixels of the frames nearby brought to where they are in the frame to clean
  bool carries = false;     ///< can average other layers with the signal's weights
  bool seeded = false;      ///< depends on the order or place of pixels, so that a turned picture differs a little
  bool background = false;  ///< knows FilterFrame::medium; the others treat every pixel unless asked otherwise
  int scratch = 16;         ///< floats per pixel that it holds while it runs
  std::vector<std::string> also_compare;  ///< "parameter=value": settings that comparisons list beside the defaults
  std::vector<Preset> presets;            ///< `paper` is as published
  std::vector<Parameter> parameters;
  std::any defaults;
  bool learned = false;  ///< is a network, and nothing without its weights
  /// Names the weights of networks that it has with these parameters, in words that change with them. Of one that is
  /// learned: throws InputError, which says how to get them, where they are not there. Null: it reads none.
  std::function<std::string(const std::any&)> weights;
  std::function<void(Layers&)> settle;        ///< finishes what it produces once all tiles are there; may be null
  std::function<int(const std::any&)> apron;  ///< pixels read beyond a tile
  std::function<void(const std::any&, const FilterFrame&, const FilterOutput&, const Task&)> run;

  const Parameter* find(std::string_view parameter) const;
  /// @throws InputError with the nearest name and the list
  const Preset& find_preset(std::string_view preset) const;
  /// Everything it reads beside the mean of its signal, and what it makes, as lines for help: "needs", "the layer
  /// flash".
  std::vector<std::pair<std::string, std::string>> inputs_and_outputs() const;
};

/// A filter with its parameters set.
class FilterSettings {
 public:
  FilterSettings(const FilterEntry& entry) : entry_(&entry), parameters_(entry.defaults) {}
  /// Sets a parameter, or with `preset` all that the preset of that name says. Parameters that were set by name keep
  /// their values, whether the preset comes before or after them.
  /// @throws InputError: no such parameter (nearest one), not a number, outside its range
  void set(const std::string& parameter, const std::string& text);
  void set(const Parameter& parameter, const Parameter::Value& value) { parameter.set(parameters_, value); }
  const FilterEntry& entry() const { return *entry_; }
  Parameter::Value get(const Parameter& parameter) const { return parameter.get(parameters_); }
  /// "sigma-domain=2 sigma-range=20"
  std::string text() const;
  int apron() const { return entry_->apron(parameters_); }
  bool uses_features() const { return entry_->features && entry_->features(parameters_); }
  std::vector<std::string> preferred_features() const {
    return entry_->feature_set ? names_of(entry_->feature_set(parameters_)) : std::vector<std::string>();
  }
  /// The weights that it has; empty: none. @throws InputError where it is learned and they are not there
  std::string weights() const { return entry_->weights ? entry_->weights(parameters_) : ""; }
  bool uses_noise_level() const { return entry_->noise_level && entry_->noise_level(parameters_); }
  void run(const FilterFrame& frame, const FilterOutput& out, const Task& task) const {
    entry_->run(parameters_, frame, out, task);
  }

 private:
  void assign(const std::string& parameter, const std::string& text);

  const FilterEntry* entry_;
  std::any parameters_;
  std::vector<std::pair<std::string, std::string>> assigned_;  // by name, in their order
};

/// Builds the declaration of a filter whose parameters are the struct P; P's initialisers are the only defaults.
template <class P>
class Declaration {
 public:
  Declaration(std::string name, std::string summary) {
    entry_.name = std::move(name);
    entry_.summary = std::move(summary);
    entry_.defaults = P{};
  }
  Declaration& source(std::string text) { return entry_.source = std::move(text), *this; }
  /// @param samples  how many times as many samples would give an unfiltered picture of the result's error
  /// @param when     for which frames to choose it, in words
  Declaration& merit(double samples, std::string when) {
    entry_.merit = samples;
    entry_.when = std::move(when);
    return *this;
  }
  Declaration& notes(std::string text) { return entry_.notes = std::move(text), *this; }
  template <class... Layer>
  Declaration& needs(const Layer&... layers) {
    return (entry_.needs.push_back(layers), ...), *this;
  }
  template <class... Layer>
  Declaration& can_use(const Layer&... layers) {
    return (entry_.can_use.push_back(layers), ...), *this;
  }

  Declaration& statistics(Statistics needed) { return statistics(needed, needed); }
  Declaration& statistics(Statistics needed, Statistics useful) {
    entry_.statistics = needed;
    entry_.can_use_statistics = useful;
    return *this;
  }
  /// At its defaults reads halves where there are any, and makes do without.
  Declaration& makes_halves() { return entry_.makes_halves = true, *this; }
  /// Of the statistics, reads the halves and not the variance.
  Declaration& no_variance() { return entry_.signal_variance = false, *this; }
  /// Reads the variance of the layers it needs or can use, where the frame has it.
  Declaration& with_variance() { return entry_.variances = true, *this; }
  /// Reads every layer `guide.*` that the frame has.
  Declaration& guides() { return entry_.guides = true, *this; }
  /// That too where those that is_only_fitted() are in Layers::stored.
  Declaration& stored_guides() { return entry_.stored_guides = true, *this; }
  /// Cleans `direct` and `indirect` apart rather than the beauty.
  Declaration& parts() { return entry_.parts = true, *this; }
  /// Runs once, on a box outside of which the result is the input, because it measures over all of it.
  Declaration& within(Box (*box)(const Layers&, const LayerName&)) { return entry_.box = box, *this; }
  /// Leaves more layers than the clean picture, in FilterOutput::products.
  template <class... Layer>
  Declaration& produces(const Layer&... layers) {
    return (entry_.produces.push_back(layers), ...), *this;
  }
  /// What those layers still need once all tiles are there.
  Declaration& settles(void (*function)(Layers&)) { return entry_.settle = function, *this; }
  /// Reads the features that the frame offers; with `when`, only for some parameters.
  Declaration& features(bool (*when)(const P&) = [](const P&) { return true; }) {
    entry_.features = [when](const std::any& a) { return when(std::any_cast<const P&>(a)); };
    return *this;
  }
  /// Is of no use without features.
  Declaration& needs_features() {
    entry_.needs_features = true;
    return features();
  }
  /// The parameter `feature-set`: which features it takes where the caller names none.
  Declaration& feature_set(FeatureSet P::*member,
                           std::vector<std::string> candidates = {"all", "scalar", "opacity", "guides"}) {
    entry_.feature_set = [member](const std::any& a) { return std::any_cast<const P&>(a).*member; };
    return param(
        "feature-set", member, {"all", "scalar", "opacity", "guides"},
        "which features it takes where `--features` names none: all but those made from guides, those without a direction, opacity, or those made from guides",
        std::move(candidates));
  }
  /// Reads the frame's noise level in CIE-Lab with these parameters.
  Declaration& noise_level(bool (*when)(const P&)) {
    entry_.noise_level = [when](const std::any& a) { return when(std::any_cast<const P&>(a)); };
    return *this;
  }
  /// Reads the file of per-sample records; can_use: in place of the bucket means.
  Declaration& needs_records() { return entry_.records = FilterEntry::Records::kNeeds, *this; }
  Declaration& can_use_records() { return entry_.records = FilterEntry::Records::kCanUse, *this; }
  /// Looks into the frames before and after. @param frame_window  so many on either side unless a caller says otherwise
  Declaration& sequences(int frame_window = 1) {
    entry_.frame_window = frame_window;
    return entry_.sequences = true, *this;
  }
  /// The same, each pixel of theirs brought to where it is in the frame to clean; where it is not found, or changed by
  /// more than noise, they show the frame to clean.
  Declaration& aligned_sequences(int frame_window = 1) {
    entry_.aligned = true;
    return sequences(frame_window);
  }
  /// Averages FilterFrame::values with weights from the signal alone.
  Declaration& carries() { return entry_.carries = true, *this; }
  /// Draws random numbers by the pixel's place, or takes pixels in an order.
  Declaration& seeded() { return entry_.seeded = true, *this; }
  /// Leaves the pixels where FilterFrame::medium is 0 to the gradient-kernel paper's rule.
  Declaration& background() { return entry_.background = true, *this; }
  /// Is a network, which has its weights from files.
  Declaration& learned(std::string (*weights)(const P&)) {
    entry_.learned = true;
    return uses_weights(weights);
  }
  /// Gains from files with weights, of which the function says which there are, and runs without.
  Declaration& uses_weights(std::string (*weights)(const P&)) {
    entry_.weights = [weights](const std::any& a) { return weights(std::any_cast<const P&>(a)); };
    return *this;
  }
  Declaration& scratch(int floats_per_pixel) { return entry_.scratch = floats_per_pixel, *this; }

  /// The preset `paper`: the parameters as published, "name=value,..." where they differ from the defaults.
  Declaration& paper(const std::string& settings) { return preset("paper", "as published", settings); }
  Declaration& preset(std::string name, std::string summary, const std::string& settings) {
    entry_.presets.push_back({std::move(name), std::move(summary), parse_assignments(settings)});
    return *this;
  }

  Declaration& also_compare(std::vector<std::string> settings) {
    entry_.also_compare = std::move(settings);
    return *this;
  }

  struct Range {
    double lowest, highest;
  };
  /// A number. `candidates` are what an exhaustive search tries.
  template <class Number>
  requires std::is_arithmetic_v<Number> Declaration& param(std::string name, Number P::*member, Range range,
                                                           std::string unit, std::string help,
                                                           std::vector<double> candidates = {}) {
    Parameter p{std::move(name),
                std::move(unit),
                std::move(help),
                range.lowest,
                range.highest,
                std::integral<Number>,
                false,
                {},
                {},
                {},
                {}};
    p.candidates.assign(candidates.begin(), candidates.end());
    p.get = [member](const std::any& a) {
      return Parameter::Value(static_cast<double>(std::any_cast<const P&>(a).*member));
    };
    p.set = [member](std::any& a, const Parameter::Value& v) {
      std::any_cast<P&>(a).*member = static_cast<Number>(std::get<double>(v));
    };
    return entry_.parameters.push_back(std::move(p)), *this;
  }
  /// A choice between names: an enumeration whose values count from 0 in the order of `choices`.
  template <class Enum>
  requires std::is_enum_v<Enum> Declaration& param(std::string name, Enum P::*member, std::vector<std::string> choices,
                                                   std::string help, std::vector<std::string> candidates = {}) {
    Parameter p{std::move(name), "", std::move(help), 0, 0, false, false, choices, {}, {}, {}};
    p.candidates.assign(candidates.begin(), candidates.end());
    p.get = [member, choices](const std::any& a) {
      return Parameter::Value(choices[static_cast<size_t>(std::any_cast<const P&>(a).*member)]);
    };
    p.set = [member, choices](std::any& a, const Parameter::Value& v) {
      for (size_t i = 0; i < choices.size(); ++i)
        if (choices[i] == std::get<std::string>(v)) std::any_cast<P&>(a).*member = static_cast<Enum>(i);
    };
    return entry_.parameters.push_back(std::move(p)), *this;
  }
  /// A text, such as the name of a file.
  Declaration& param(std::string name, std::string P::*member, std::string help) {
    Parameter p{std::move(name), "", std::move(help), 0, 0, false, true, {}, {}, {}, {}};
    p.get = [member](const std::any& a) { return Parameter::Value(std::any_cast<const P&>(a).*member); };
    p.set = [member](std::any& a, const Parameter::Value& v) {
      std::any_cast<P&>(a).*member = std::get<std::string>(v);
    };
    return entry_.parameters.push_back(std::move(p)), *this;
  }
  Declaration& apron(int (*pixels)(const P&)) {
    entry_.apron = [pixels](const std::any& a) { return pixels(std::any_cast<const P&>(a)); };
    return *this;
  }
  FilterEntry run(void (*function)(const P&, const FilterFrame&, const FilterOutput&, const Task&)) {
    entry_.run = [function](const std::any& a, const FilterFrame& f, const FilterOutput& o, const Task& t) {
      function(std::any_cast<const P&>(a), f, o, t);
    };
    return entry_;
  }

 private:
  FilterEntry entry_;
};

template <class P>
Declaration<P> declare(std::string name, std::string summary) {
  return {std::move(name), std::move(summary)};
}

}  // namespace brume
