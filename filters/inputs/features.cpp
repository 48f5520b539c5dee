#include "filters/inputs/features.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "base/error.h"
#include "base/text.h"
#include "filters/inputs/guide_layers.h"
#include "filters/inputs/planes.h"

namespace brume {
namespace {

/// Pixel by pixel from several planes of the size of `a`.
template <class Function>
Plane combine(const Plane& a, const Task& task, const Function& f) {
  return make_plane(a.width(), a.height(), quiet(task), f);
}

using Planes = std::vector<Plane>;

/// How one feature is computed from its layers.
struct Recipe {
  std::string name;
  std::vector<LayerName> layers;
  /// Means (statistic "", half_a, half_b) of the feature.
  std::function<Planes(const Layers&, std::string_view, const Task&)> mean;
  /// Variance of the mean, to first order.
  std::function<Planes(const Layers&, const Task&)> variance;
};

Planes copies(const Layers& frame, const LayerName& layer, std::string_view statistic) {
  Planes planes;
  for (const std::string& name : layer.channel_names(statistic)) planes.push_back(frame.at(name));
  return planes;
}

Recipe plain(std::string name, const LayerName& layer) {
  return {std::move(name),
          {layer},
          [layer](const Layers& frame, std::string_view which, const Task&) { return copies(frame, layer, which); },
          [layer](const Layers& frame, const Task&) { return copies(frame, layer, statistic::mean_variance); }};
}

/// A layer that is a sum over the paths which scattered, divided by their share.
Recipe per_scattered(std::string name, const LayerName& layer) {
  const auto share = [](const Layers& frame, std::string_view which) -> const Plane& {
    return frame.at(layer::scatter_share.channel_of(which, 0));
  };
  const auto mean = [layer, share](const Layers& frame, std::string_view which, const Task& task) {
    Planes planes = copies(frame, layer, which);
    const Plane& s = share(frame, which);
    for (Plane& p : planes) p = combine(p, task, [&](int x, int y) { return s(x, y) > 0 ? p(x, y) / s(x, y) : 0.0f; });
    return planes;
  };
  // Of D / S where D = S d: Cov(D, S) = d Var S, so that Var(D / S) = (Var D - d^2 Var S) / S^2.
  const auto variance = [layer, share, mean](const Layers& frame, const Task& task) {
    const Planes ratio = mean(frame, "", task);
    Planes planes = copies(frame, layer, statistic::mean_variance);
    const Plane &s = share(frame, ""), &v = share(frame, statistic::mean_variance);
    for (size_t c = 0; c < planes.size(); ++c)
      planes[c] = combine(s, task, [&](int x, int y) {
        const float r = ratio[c](x, y);
        return s(x, y) > 0 ? std::max(0.0f, planes[c](x, y) - r * r * v(x, y)) / (s(x, y) * s(x, y)) : 0.0f;
      });
    return planes;
  };
  return {std::move(name), {layer, layer::scatter_share}, mean, variance};
}

/// One number from three channels that vary together.
Recipe grey(std::string name, const LayerName& layer, bool complement) {
  const auto mean = [layer, complement](const Layers& frame, std::string_view which, const Task& task) {
    const RgbPlanes rgb = frame.rgb(layer, which);
    const FrameSpace space(frame);
    Planes planes;
    planes.push_back(combine(*rgb[0], task, [&](int x, int y) {
      const float m = space.luminance(color_at(rgb, x, y));
      return complement ? 1.0f - m : m;
    }));
    return planes;
  };
  const auto variance = [layer](const Layers& frame, const Task& task) {
    const RgbPlanes v = frame.rgb(layer, statistic::mean_variance);
    const FrameSpace space(frame);
    Planes planes;
    planes.push_back(combine(*v[0], task, [&](int x, int y) {
      const auto deviation = [&](size_t c) { return std::sqrt(std::max(0.0f, (*v[c])(x, y))); };
      const float sum = space.luminance(vec3(deviation(0), deviation(1), deviation(2)));
      return sum * sum;
    }));
    return planes;
  };
  return {std::move(name), {layer}, mean, variance};
}

Recipe opacity_from_depth() {
  const auto mean = [](const Layers& frame, std::string_view which, const Task& task) {
    const Plane& tau = frame.at(layer::optical_depth.channel_of(which, 0));
    Planes planes;
    planes.push_back(combine(tau, task, [&](int x, int y) { return 1.0f - std::exp(-tau(x, y)); }));
    return planes;
  };
  const auto variance = [](const Layers& frame, const Task& task) {
    const Plane &tau = frame.at(layer::optical_depth.channel(0)),
                &v = frame.at(layer::optical_depth.channel_of(statistic::mean_variance, 0));
    Planes planes;
    planes.push_back(combine(tau, task, [&](int x, int y) { return v(x, y) * std::exp(-2 * tau(x, y)); }));
    return planes;
  };
  return {"opacity", {layer::optical_depth}, mean, variance};
}

/// Of several recipes with one name the first whose layers a frame has is taken.
const std::vector<Recipe>& recipes() {
  static const std::vector<Recipe> table = {
      opacity_from_depth(),
      grey("opacity", layer::transmittance, /*complement=*/true),
      per_scattered("scatter-depth", layer::scatter_depth),
      plain("gradient", layer::gradient_transmittance_weighted),
      plain("gradient", layer::gradient),
      grey("single", layer::single, false),
      plain("albedo", layer::albedo),
      plain("normal", layer::normal),
      plain("surface-depth", layer::depth),
      plain("guide-opacity", guide_layer::opacity),
      plain("guide-depth", guide_layer::depth),
      plain("guide-spread", guide_layer::spread),
      plain("guide-density", guide_layer::density),
      plain("guide-gradient", guide_layer::gradient),
      plain("guide-direct", guide_layer::predicted_direct),
      plain("guide-indirect", guide_layer::predicted_indirect),
      plain("guide-emission", guide_layer::emission),
      plain("guide-background", guide_layer::background),
      plain("guide-normal", guide_layer::normal),
  };
  return table;
}

bool offered(const Recipe& recipe, const Layers& frame) {
  return std::all_of(recipe.layers.begin(), recipe.layers.end(), [&](const LayerName& l) { return frame.has(l); });
}

bool knows(const Recipe& recipe, const Layers& frame, std::string_view statistic) {
  return std::all_of(recipe.layers.begin(), recipe.layers.end(),
                     [&](const LayerName& l) { return frame.has(l, statistic); });
}

/// What decides about a feature, over the whole frame.
struct Facts {
  float lowest = 0, highest = 0;  // 1st and 99th percentile, over all channels
  double spread = 0, noise = 0;   // variance over the frame, mean variance of the mean; channels summed
};

Facts facts_of(const Planes& mean, const Planes& variance) {
  Facts facts;
  std::vector<float> values;
  // Percentiles of some ten thousand values of each channel.
  const double pixels = static_cast<double>(mean[0].width()) * mean[0].height();
  const int step = std::max(1, static_cast<int>(pixels / 20000));
  for (size_t c = 0; c < mean.size(); ++c) {
    double sum = 0, squares = 0, noise = 0;
    for (int y = 0; y < mean[c].height(); ++y)
      for (int x = 0; x < mean[c].width(); ++x) {
        const double v = mean[c](x, y);
        sum += v;
        squares += v * v;
        if (!variance.empty()) noise += variance[c](x, y);
        if ((x + y * mean[c].width()) % step == 0) values.push_back(mean[c](x, y));
      }
    const double n = static_cast<double>(mean[c].width()) * mean[c].height();
    facts.spread += std::max(0.0, squares / n - sum * sum / (n * n));
    facts.noise += noise / n;
  }
  if (values.empty()) return facts;
  std::sort(values.begin(), values.end());
  const auto at = [&](double share) {
    return values[static_cast<size_t>(share * static_cast<double>(values.size() - 1))];
  };
  facts.lowest = at(0.01);
  facts.highest = at(0.99);
  if (!(facts.highest > facts.lowest)) {
    facts.lowest = values.front();
    facts.highest = values.back();
  }
  return facts;
}

}  // namespace

bool FeaturePlan::is_of_guides(std::string_view name) {
  return name.starts_with("guide");
}

std::vector<std::string> FeaturePlan::names() {
  std::vector<std::string> names;
  for (const Recipe& r : recipes())
    if (std::find(names.begin(), names.end(), r.name) == names.end()) names.push_back(r.name);
  return names;
}

const std::vector<LayerName>& FeaturePlan::sources() {
  static const std::vector<LayerName> list = [] {
    std::vector<LayerName> all;
    for (const Recipe& r : recipes())
      for (const LayerName& l : r.layers)
        if (std::find(all.begin(), all.end(), l) == all.end()) all.push_back(l);
    return all;
  }();
  return list;
}

FeaturePlan::FeaturePlan(const Layers& frame, const std::vector<std::string>& named, const Task& task) {
  const std::vector<std::string> known = names();
  std::vector<std::string> wanted;
  for (const std::string& name : named)
    if (name == kGuides)
      std::copy_if(known.begin(), known.end(), std::back_inserter(wanted), is_of_guides);
    else
      wanted.push_back(name);
  for (const std::string& name : wanted)
    if (name != "none" && std::find(known.begin(), known.end(), name) == known.end())
      throw InputError(fmt::format("no feature '{}'{}", name, suggestion(name, known)));
  std::vector<std::string> taken, left;
  for (const std::string& name : known) {
    if (wanted.empty() ? is_of_guides(name) : std::find(wanted.begin(), wanted.end(), name) == wanted.end()) continue;
    const auto& table = recipes();
    const auto recipe =
        std::find_if(table.begin(), table.end(), [&](const Recipe& r) { return r.name == name && offered(r, frame); });
    if (recipe == table.end()) {
      // Of guides a frame has those that its scene has a use for.
      if (!is_of_guides(name) || named.front() != kGuides) left.push_back(name + " (not recorded)");
      continue;
    }
    const bool measured = knows(*recipe, frame, statistic::mean_variance);
    const Facts facts = facts_of(recipe->mean(frame, "", task), measured ? recipe->variance(frame, task) : Planes());
    if (!(facts.highest - facts.lowest > 1e-5f * std::max(1.0f, std::abs(facts.highest)))) {
      left.push_back(name + " (constant)");
    } else if (facts.noise > 0.5 * facts.spread) {
      left.push_back(name + " (noisier than its signal)");
    } else {
      chosen_.push_back(
          {static_cast<size_t>(recipe - table.begin()), facts.lowest, 1.0f / (facts.highest - facts.lowest)});
      taken.push_back(name + (measured ? "" : " (taken as free of noise)"));
    }
  }
  note_ = fmt::format("features: {}{}{}", taken.empty() ? "none" : join(taken), left.empty() ? "" : "; without ",
                      join(left));
}

FeaturePlan FeaturePlan::choose(const Layers& frame, const std::vector<std::string>& named,
                                const std::vector<std::string>& preferred, const Task& task) {
  FeaturePlan plan(frame, named.empty() ? preferred : named, task);
  if (!plan.empty() || !named.empty() || preferred.empty()) return plan;
  return FeaturePlan(frame, {}, task);
}

std::vector<Feature> FeaturePlan::build(const Layers& frame, Parts parts, const Task& task) const {
  std::vector<Feature> features;
  for (const Chosen& chosen : chosen_) {
    const Recipe& recipe = recipes()[chosen.index];
    const auto mapped = [&](Planes planes) {
      for (Plane& p : planes)
        for_each_row(p.height(), quiet(task), [&](int y) {
          for (float& v : p.pixels(y)) v = (v - chosen.offset) * chosen.scale;
        });
      return planes;
    };
    Feature f;
    f.name = recipe.name;
    f.mean = mapped(recipe.mean(frame, "", task));
    if (parts.halves) {
      const bool halves = knows(recipe, frame, statistic::half_a) && knows(recipe, frame, statistic::half_b);
      f.half_a = halves ? mapped(recipe.mean(frame, statistic::half_a, task)) : f.mean;
      f.half_b = halves ? mapped(recipe.mean(frame, statistic::half_b, task)) : f.mean;
    }
    if (parts.variance && knows(recipe, frame, statistic::mean_variance)) {
      f.variance = recipe.variance(frame, task);
      for (Plane& p : f.variance)
        for_each_row(p.height(), quiet(task), [&](int y) {
          for (float& v : p.pixels(y)) v *= chosen.scale * chosen.scale;
        });
    } else if (parts.variance) {
      for (const Plane& p : f.mean) f.variance.emplace_back(p.width(), p.height());
    }
    features.push_back(std::move(f));
  }
  return features;
}

}  // namespace brume
