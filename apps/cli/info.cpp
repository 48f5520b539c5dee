#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>

#include "apps/cli/command.h"
#include "base/error.h"
#include "base/file_kind.h"
#include "base/text.h"
#include "image/cryptomatte.h"
#include "image/exr_deep.h"
#include "image/exr_io.h"
#include "image/foreign.h"
#include "volume/vdb_io.h"
#include "workflows/scene.h"

namespace brume::app {
namespace {

using nlohmann::json;

json to_json(const dvec3& v) {
  return {v.x, v.y, v.z};
}
json to_json(const ivec3& v) {
  return {v.x, v.y, v.z};
}

std::string format_transform(const dmat4& m) {
  std::string text;
  for (int row = 0; row < 3; ++row)
    text += fmt::format("    {:>12.6g} {:>12.6g} {:>12.6g} {:>12.6g}\n", m[0][row], m[1][row], m[2][row], m[3][row]);
  return text;
}

/// The corners of the box around the cells of a grid's active voxels, half a voxel beyond their centres, in world
/// space.
std::pair<dvec3, dvec3> world_bounds(const GridSummary& g) {
  dvec3 lo(std::numeric_limits<double>::infinity()), hi = -lo;
  for (int corner = 0; corner < 8; ++corner) {
    dvec3 index;
    for (int axis = 0; axis < 3; ++axis) index[axis] = corner >> axis & 1 ? g.box.hi[axis] + 0.5 : g.box.lo[axis] - 0.5;
    const dvec3 world(g.world_from_index * glm::dvec4(index, 1.0));
    lo = glm::min(lo, world);
    hi = glm::max(hi, world);
  }
  return {lo, hi};
}

int info_vdb(const std::string& path, bool as_json) {
  const VdbSummary s = read_vdb_info(path, {0, {}, &interrupted});
  json grids = json::array();
  std::string text = fmt::format("{}: OpenVDB {}, {:.2f} MB, {} grids\n", path, s.library_version,
                                 static_cast<double>(s.bytes) / 1e6, s.grids.size());
  for (const auto& [key, value] : s.metadata) text += fmt::format("  {} = {}\n", key, value);
  for (const GridSummary& g : s.grids) {
    json j = {{"name", g.name},
              {"type", g.type},
              {"class", g.grid_class},
              {"compression", g.compression},
              {"half", g.half},
              {"linear_transform", g.linear},
              {"active_voxels", g.active_voxels},
              {"active_tiles", g.active_tiles},
              {"voxel_size", to_json(g.voxel_size)},
              {"metadata", g.metadata}};
    text += fmt::format(
        "\n{}{}\n  type          {}{}, {}{}\n", g.name, grid_name_alone(g.name).empty() ? " (without a name)" : "",
        g.type, g.half ? " saved as half" : "", g.grid_class, g.compression.empty() ? "" : ", " + g.compression);
    if (const auto level = level_of(s.entries(), g.name)) {
      text +=
          fmt::format("  level         {} of '{}', coarser: read only where it is named\n", level->level, level->of);
      j["level"] = level->level, j["level_of"] = level->of;
    }
    if (g.box.empty()) {
      text += "  active        none: an empty grid\n";
    } else {
      text += fmt::format("  active        {} voxels, {} tiles, box [{} {} {}] .. [{} {} {}]\n", g.active_voxels,
                          g.active_tiles, g.box.lo.x, g.box.lo.y, g.box.lo.z, g.box.hi.x, g.box.hi.y, g.box.hi.z);
      j["box"] = {to_json(g.box.lo), to_json(g.box.hi)};
    }
    text += fmt::format("  voxel size    {:.6g} {:.6g} {:.6g}\n", g.voxel_size.x, g.voxel_size.y, g.voxel_size.z);
    if (g.has_range) {
      text += fmt::format("  values        {:.6g} .. {:.6g}, background {:.6g}\n", g.minimum, g.maximum, g.background);
      j["minimum"] = g.minimum, j["maximum"] = g.maximum, j["background"] = g.background;
    }
    if (g.nan_count || g.infinite_count || g.negative_count) {
      text += fmt::format("  odd values    {} NaN, {} infinite, {} negative\n", g.nan_count, g.infinite_count,
                          g.negative_count);
      j["nan"] = g.nan_count, j["infinite"] = g.infinite_count, j["negative"] = g.negative_count;
    }
    text += g.linear ? "  world from index\n" + format_transform(g.world_from_index)
                     : "  transform     a frustum, sampled on equal cubes where it is rendered\n";
    if (g.linear && !g.box.empty()) {
      const auto [lo, hi] = world_bounds(g);
      text += fmt::format("  world bounds  [{:.6g} {:.6g} {:.6g}] .. [{:.6g} {:.6g} {:.6g}]\n", lo.x, lo.y, lo.z, hi.x,
                          hi.y, hi.z);
      j["world_bounds"] = {to_json(lo), to_json(hi)};
    }
    if (g.linear) {
      json rows = json::array();
      for (int row = 0; row < 4; ++row)
        rows.push_back({g.world_from_index[0][row], g.world_from_index[1][row], g.world_from_index[2][row],
                        g.world_from_index[3][row]});
      j["world_from_index"] = rows;
    }
    grids.push_back(j);
  }
  print(as_json ? json{{"file", path},
                       {"kind", "vdb"},
                       {"library_version", s.library_version},
                       {"metadata", s.metadata},
                       {"grids", grids}}
                          .dump(2, ' ', false, nlohmann::json::error_handler_t::replace) +
                      "\n"
                : text);
  return kDone;
}

json to_json(const Attribute& a) {
  return std::visit([](const auto& v) -> json { return v; }, a);
}

/// What `denoise` makes of another renderer's frame.
void describe(const ForeignFrame& picture, std::string& text, json& list) {
  static const char* const meanings[] = {"variance of the mean", "variance of the samples", "second moment",
                                         "variance of unstated meaning"};
  const auto described = [](const ForeignSignal& signal) {
    std::string line = signal.name;
    if (signal.variance) line += fmt::format(", with {}", meanings[static_cast<size_t>(signal.variance->meaning)]);
    if (signal.halves) line += ", with halves";
    return line;
  };
  json j = {{"read_as", picture.label()}, {"color", picture.color.channels}, {"samples", picture.samples}};
  text += fmt::format("  read as {}: {}", picture.label(), described(picture.color));
  for (const ForeignSignal& pass : picture.passes) {
    j["passes"].push_back({{"name", pass.name}, {"channels", pass.channels}});
    text += fmt::format("; {}{}", &pass == &picture.passes.front() ? "passes " : "", described(pass));
  }
  for (const ForeignFeature& feature : picture.features) {
    j["features"][std::string(feature.layer.name)] = feature.channels;
    text += fmt::format("; {}{}", &feature == &picture.features.front() ? "features " : "", feature.layer.name);
  }
  text += picture.samples > 0 ? fmt::format("; {:g} samples per pixel\n", picture.samples) : "\n";
  for (const ChannelTriple& other : picture.alike) {
    text += fmt::format(
        "    {} {} {} could be the picture, too: cleaned alike where they hold the same pixels, else refused until --map says which\n",
        other[0], other[1], other[2]);
    j["alike"].push_back(other);
  }
  for (const std::string& remark : picture.remarks) text += fmt::format("    {}\n", remark);
  for (const std::string& conflict : picture.conflicts) text += fmt::format("  {}\n", conflict);
  if (!picture.conflicts.empty()) j["conflicts"] = picture.conflicts;
  list.push_back(j);
}

/// How many samples deep pixels have, and at which depths; or why they cannot be read.
void describe_deep(const std::string& path, std::string& text, json& j) try {
  const DeepPicture deep = read_deep_exr(path, {0, {}, &interrupted});
  const double pixels = static_cast<double>(deep.width()) * deep.height();
  text += fmt::format("  deep: {} samples, {:.2f} in a pixel, {} at most", deep.samples(),
                      static_cast<double>(deep.samples()) / pixels, deep.most_samples());
  j["deep"] = {{"samples", deep.samples()}, {"most_samples", deep.most_samples()}};
  const DeepPicture::Channel *const z = deep.find("Z"), *const back = deep.find("ZBack");
  if (z && !z->values.empty()) {
    const float nearest = *std::min_element(z->values.begin(), z->values.end());
    const std::vector<float>& ends = (back ? back : z)->values;
    const float farthest = *std::max_element(ends.begin(), ends.end());
    text += fmt::format(", depths {:.6g} .. {:.6g}{}", nearest, farthest, back ? "" : ", all of them points");
    j["deep"]["depths"] = {nearest, farthest};
  }
  text += "\n";
} catch (const InputError& error) {
  text += fmt::format("  deep: {}\n", error.what());
  j["deep"] = {{"error", error.what()}};
}

/// Its Cryptomatte layers and the names of their things.
json describe_mattes(const std::string& path, const ExrInfo& info, std::string& text) {
  std::vector<std::string> names;
  for (const ExrInfo::Channel& channel : info.channels) names.push_back(channel.name);
  std::vector<MatteLayer> layers = matte_layers(info.header, names);
  read_manifests(layers, path);
  json all = json::array();
  for (const MatteLayer& layer : layers) {
    json j = {{"name", layer.name}, {"levels", layer.ranks.size()}, {"manifest", json::object()}};
    std::vector<std::string> things;
    for (const auto& [name, id] : layer.manifest) {
      things.push_back(name);
      j["manifest"][name] = matte_hex(id);
    }
    if (!layer.problem.empty()) j["problem"] = layer.problem;
    text += fmt::format("  Cryptomatte {}, {} levels: {}{}\n", layer.name, layer.ranks.size(),
                        things.empty() ? "without a manifest" : join(things),
                        layer.problem.empty() ? "" : "; " + layer.problem);
    all.push_back(j);
  }
  return all;
}

/// The parts of a file that has several, and the views of one that names them.
json describe_parts(const ExrInfo& info, std::string& text) {
  json parts = json::array();
  if (!info.views.empty()) text += fmt::format("  views {} (multiView)\n", join(info.views));
  for (const ExrInfo::Part& part : info.parts) {
    parts.push_back({{"name", part.name},
                     {"view", part.view},
                     {"type", part.type},
                     {"channels", part.channels},
                     {"data_window", {part.data.lo.x, part.data.lo.y, part.data.hi.x, part.data.hi.y}}});
    if (info.parts.size() < 2 && !part.deep()) continue;
    text += fmt::format("  part {}{}: {}{}{}\n", part.name.empty() ? "without a name" : part.name,
                        part.view.empty() ? "" : fmt::format(" (view {})", part.view), join(part.channels, " "),
                        part.type == "scanlineimage" ? "" : ", " + part.type,
                        part.data == info.data ? "" : ", data window " + part.data.text());
  }
  return parts;
}

/// "OpenEXR", or what else is read as one.
std::string format_of(const std::string& path) {
  const KnownFile file = known_file(path);
  return file.kind == FileKind::kOpenExr ? "OpenEXR" : file.what;
}

int info_exr(const std::string& path, bool as_json) {
  const ExrInfo info = read_exr_info(path);
  json channels = json::array(), header;
  std::string text = fmt::format("{}: {}, {} x {}, {}, {} channels\n", path, format_of(path), info.width, info.height,
                                 info.compression, info.channels.size());
  if (info.data != info.display)
    text += fmt::format("  data window {}, display window {}\n", info.data.text(), info.display.text());
  for (const auto& [name, value] : info.header) {
    header[name] = to_json(value);
    if (name.starts_with("cryptomatte/")) continue;  // below
    const std::string shown = header[name].is_string() ? header[name].get<std::string>() : header[name].dump();
    text += fmt::format("  {} = {}\n", name, join(split(shown, '\n'), "\n      "));
  }
  const json parts = describe_parts(info, text);
  const json mattes = describe_mattes(path, info, text);
  json pictures = json::array(), deep;
  if (std::any_of(info.parts.begin(), info.parts.end(), [](const ExrInfo::Part& p) { return p.deep(); }))
    describe_deep(path, text, deep);
  if (!is_brume_frame(info) && !info.deep()) {
    for (const ForeignFrame& picture : recognise(info)) describe(picture, text, pictures);
    if (pictures.empty())
      text += "  no picture is recognised in it: brume denoise --map says which layer is one (docs/frames.md)\n";
  }
  text += "\n";
  for (const ExrInfo::Channel& c : info.channels) {
    channels.push_back({{"name", c.name}, {"type", c.type}});
    text += fmt::format("  {:<36} {}\n", c.name, c.type);
  }
  json all{{"file", path},
           {"kind", "exr"},
           {"width", info.width},
           {"height", info.height},
           {"data_window", {info.data.lo.x, info.data.lo.y, info.data.hi.x, info.data.hi.y}},
           {"views", info.views},
           {"parts", parts},
           {"pictures", pictures},
           {"mattes", mattes},
           {"channels", channels},
           {"header", header}};
  all.update(deep.is_null() ? json::object() : deep);
  print(as_json ? all.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n" : text);
  return kDone;
}

}  // namespace

void add_info(CLI::App& app, Common& common, Commands& commands) {
  const auto file = std::make_shared<std::string>();
  const Verb command = add_command(app, common, "info", "what is in a VDB or EXR file");
  command("file", *file, "an OpenVDB, NanoVDB or OpenEXR file")->required();
  command("--json", common.json, "as one JSON object");
  commands[command] = [file, &common] {
    const std::string& path = *file;
    const KnownFile known = known_file(path);
    const bool exr =
        known.kind == FileKind::kOpenExr || known.kind == FileKind::kRadiance || known.kind == FileKind::kFloatMap;
    check_readable(path, "an OpenVDB or OpenEXR file");
    if (!exr && !is_volume(path))
      throw InputError(fmt::format("{}: is neither an OpenVDB nor an OpenEXR file (by its first bytes){}", path,
                                   known.what.empty() ? "" : ": it is " + known.what));
    return exr ? info_exr(path, common.json) : info_vdb(path, common.json);
  };
}

}  // namespace brume::app
