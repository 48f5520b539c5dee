#include "evaluate/report/strips.h"

#include <fmt/format.h>

#include <algorithm>

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wconversion"
#pragma GCC diagnostic ignored "-Wuseless-cast"
#include <stb_easy_font.h>
#pragma GCC diagnostic pop

namespace brume {
namespace {

constexpr double kFullScale = 10.0;  // Lab units at the top of the error maps' colours
constexpr int kCaption = 26, kGap = 4, kKeyWidth = 200;

int text_width(std::string text) {
  return stb_easy_font_width(text.data());
}

struct Column {
  std::string caption;
  const Layers* frame;
};

}  // namespace

void draw_text(Picture& picture, int x, int y, const std::string& text, int scale) {
  struct Vertex {
    float x, y, z;
    unsigned char colour[4];
  };
  std::vector<Vertex> vertices(text.size() * 100 + 100);
  std::string copy = text;
  const int quads = stb_easy_font_print(0, 0, copy.data(), nullptr, vertices.data(),
                                        static_cast<int>(vertices.size() * sizeof(Vertex)));
  for (int q = 0; q < quads; ++q) {
    const Vertex &a = vertices[static_cast<size_t>(4 * q)], &c = vertices[static_cast<size_t>(4 * q + 2)];
    for (int py = static_cast<int>(a.y) * scale; py < static_cast<int>(c.y) * scale; ++py)
      for (int px = static_cast<int>(a.x) * scale; px < static_cast<int>(c.x) * scale; ++px)
        picture.set(x + px, y + py, {0, 0, 0});
  }
}

Picture error_picture(const Plane& error, double full) {
  Picture picture(error.width(), error.height());
  for (int y = 0; y < error.height(); ++y)
    for (int x = 0; x < error.width(); ++x) {
      const double v = std::clamp(error(x, y) / full, 0.0, 1.0);
      const auto channel = [&](double start) {
        return static_cast<uint8_t>(255.0 * std::clamp(3.0 * v - start, 0.0, 1.0));
      };
      picture.set(x, y, {channel(0), channel(1), channel(2)});
    }
  return picture;
}

std::optional<Picture> comparison_strip(const SceneResult& scene, int spp, Tuning tuning) {
  const MethodResult* noisy = scene.find("", Tuning::kNone, spp);
  std::vector<Column> columns = {{fmt::format("{} spp  {:.2f}", spp, noisy->whole().mean), &noisy->example}};
  for (const MethodResult& m : scene.methods)
    if (m.spp == spp && m.tuning == tuning && m.failed.empty())
      columns.push_back({fmt::format("{}  {:.2f}", m.filter, m.whole().mean), &m.example});
  if (columns.size() == 1) return std::nullopt;
  columns.push_back({scene.reference_spp > 0 ? fmt::format("reference {} spp", scene.references * scene.reference_spp)
                                             : std::string("reference"),
                     &scene.reference});

  // Cells are as wide as the widest caption asks for; small pictures leave room.
  const int h = scene.height, scale = scene.width >= 300 ? 2 : 1;
  int w = std::max(scene.width, kKeyWidth);
  for (const Column& column : columns) w = std::max(w, 8 + scale * text_width(column.caption));
  Picture strip(static_cast<int>(columns.size()) * (w + kGap) - kGap, 2 * h + kGap + 2 * kCaption);
  const LabRms metric(scene.reference.rgb(layer::beauty), nullptr, scene.policy, {});
  for (size_t i = 0; i < columns.size(); ++i) {
    const int x = static_cast<int>(i) * (w + kGap);
    draw_text(strip, x + 4, 6, columns[i].caption, scale);
    strip.paste(to_picture(columns[i].frame->rgb(layer::beauty), scene.policy.exposure), x, kCaption);
    if (i + 1 < columns.size())
      strip.paste(error_picture(metric.error_map(columns[i].frame->rgb(layer::beauty)), kFullScale), x,
                  kCaption + h + kGap);
  }
  // A key to the error maps, under the reference.
  const int x0 = static_cast<int>(columns.size() - 1) * (w + kGap), y0 = kCaption + h + kGap;
  Plane ramp(w - 8, 16);
  for (int y = 0; y < ramp.height(); ++y)
    for (int x = 0; x < ramp.width(); ++x) ramp(x, y) = static_cast<float>(kFullScale * x / (ramp.width() - 1));
  strip.paste(error_picture(ramp, kFullScale), x0 + 4, y0 + 24);
  draw_text(strip, x0 + 4, y0 + 4, "Lab distance to the reference", 1);
  draw_text(strip, x0 + 4, y0 + 44, fmt::format("0 ... {:.0f}", kFullScale), 1);
  draw_text(strip, x0 + 4, y0 + 60, fmt::format("numbers: Lab RMS, whole frame"), 1);
  draw_text(strip, x0 + 4, y0 + 76, fmt::format("parameters: {}", tuning_name(tuning)), 1);
  return strip;
}

}  // namespace brume
