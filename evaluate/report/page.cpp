#include "evaluate/report/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/text.h"
#include "evaluate/report/page_bundle.h"
#include "evaluate/report/report.h"
#include "image/packed_half.h"

namespace brume {
namespace {

using json = nlohmann::ordered_json;

std::string base64(const std::vector<uint8_t>& bytes) {
  constexpr std::string_view kDigits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (size_t i = 0; i < bytes.size(); i += 3) {
    const size_t count = std::min<size_t>(3, bytes.size() - i);
    uint32_t word = 0;
    for (size_t k = 0; k < 3; ++k) word = word << 8 | (k < count ? bytes[i + k] : 0u);
    for (size_t k = 0; k < 4; ++k) text += k <= count ? kDigits[word >> (18 - 6 * k) & 63] : '=';
  }
  return text;
}

/// JSON inside a script element, which would end at the first "</script" in one of its texts.
std::string inside_script(std::string text) {
  return replaced(std::move(text), "<", "\\u003c");
}

/// Pictures for the page; equal ones, as of settings that came to the same, are kept once.
struct PictureList {
  json entries = json::array();
  std::vector<std::string> packed;

  void add(const std::string& scene, int spp, const std::string& method, const Layers& frame) {
    std::string text = base64(pack_half(frame.rgb(layer::beauty)));
    const auto same = std::find(packed.begin(), packed.end(), text);
    entries.push_back({{"scene", scene},
                       {"spp", spp},
                       {"method", method},
                       {"width", frame.width()},
                       {"height", frame.height()},
                       {"data", same - packed.begin()}});
    if (same == packed.end()) packed.push_back(std::move(text));
  }
};

}  // namespace

bool page_is_built_in() {
  return !page_script.empty();
}

std::string results_page(const Evaluation& e) {
  if (!page_is_built_in()) throw std::logic_error("this program was built without its page");
  PictureList pictures;
  std::vector<std::string> names;
  for (const SceneResult& scene : e.scenes) {
    names.push_back(scene.name);
    pictures.add(scene.name, 0, "reference", scene.reference);
    for (const MethodResult& m : scene.methods)
      if (m.failed.empty()) pictures.add(scene.name, m.spp, m.id(), m.example);
  }
  // The policy keeps the page from asking any host for anything. The front end stands before the pictures: it shows
  // tables while the browser still reads.
  std::string html = fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n"
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<style>{}</style>\n</head>\n<body>\n"
      "<noscript>This page needs JavaScript; the same numbers are in table.md beside it.</noscript>\n"
      "<div id=\"app\"></div>\n"
      "<script type=\"application/json\" id=\"results\">{}</script>\n"
      "<script type=\"application/json\" id=\"pictures\">{}</script>\n"
      "<script>{}</script>\n",
      replaced(replaced("brume: " + join(names), "&", "&amp;"), "<", "&lt;"), page_style,
      inside_script(json::parse(json_report(e)).dump()), inside_script(pictures.entries.dump()), page_script);
  for (size_t i = 0; i < pictures.packed.size(); ++i)
    html += fmt::format("<script type=\"text/plain\" id=\"picture-{}\">{}</script>\n", i, pictures.packed[i]);
  return html + "</body>\n</html>\n";
}

}  // namespace brume
