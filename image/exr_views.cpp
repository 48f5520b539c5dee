#include "image/exr_views.h"

#include <algorithm>
#include <cctype>
#include <map>
#include <set>

#include "base/text.h"

namespace brume {
namespace {

constexpr std::string_view kSeparators = "._- ";

bool alike(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](unsigned char x, unsigned char y) { return std::tolower(x) == std::tolower(y); });
}

/// Calls visit(begin, end) for the words of a name, last one first, until it returns true.
template <class Visit>
bool any_word_from_last(const std::string& name, const Visit& visit) {
  size_t end = name.size();
  while (true) {
    const size_t before = end == 0 ? std::string::npos : name.find_last_of(kSeparators, end - 1);
    const size_t begin = before == std::string::npos ? 0 : before + 1;
    if (begin < end && visit(begin, end)) return true;
    if (before == std::string::npos) return false;
    end = before;
  }
}

/// "depth" of "depth_left" and "left"; empty where nothing else is left.
std::string without_word(const std::string& name, const std::string& word) {
  std::string rest = name;
  if (word.empty()) return rest;
  any_word_from_last(name, [&](size_t begin, size_t end) {
    if (!alike(std::string_view(name).substr(begin, end - begin), word)) return false;
    if (begin > 0)
      --begin;
    else if (end < name.size())
      ++end;
    rest = name.substr(0, begin) + name.substr(end);
    return true;
  });
  return rest;
}

/// The eye in a part's name, where its attributes name none: left or right, or one of the views of other parts.
std::string view_in_name(const std::string& name, const std::set<std::string>& known) {
  std::string found;
  any_word_from_last(name, [&](size_t begin, size_t end) {
    const std::string_view word = std::string_view(name).substr(begin, end - begin);
    for (const std::string& view : known)
      if (alike(word, view)) found = view;
    return !found.empty();
  });
  return found;
}

/// What a part's name says beside what its attributes do.
struct PartName {
  std::string view;  ///< empty: none
  std::string stem;  ///< without the view
};

/// Names like "rgba_L" and "rgba_R" are the eyes of one layer where both are there.
void find_eyes_by_letter(const ExrInfo& file, std::vector<PartName>& names) {
  std::map<std::string, std::map<char, size_t>> found;
  for (size_t p = 0; p < names.size(); ++p) {
    const std::string& name = file.parts[p].name;
    if (name.size() < 3 || kSeparators.find(name[name.size() - 2]) == std::string_view::npos) continue;
    const char letter = static_cast<char>(std::tolower(static_cast<unsigned char>(name.back())));
    if (letter == 'l' || letter == 'r') found[name.substr(0, name.size() - 2)][letter] = p;
  }
  for (const auto& [stem, eyes] : found)
    if (eyes.size() == 2) names[eyes.at('l')] = {"left", stem}, names[eyes.at('r')] = {"right", stem};
}

std::vector<PartName> names_of_parts(const ExrInfo& file) {
  std::set<std::string> known;
  for (const ExrInfo::Part& part : file.parts)
    if (!part.view.empty()) known.insert(part.view);
  const bool told = !known.empty();
  known.insert({"left", "right"});
  if (!told) known.insert("main");  // Nuke's only view
  std::vector<PartName> names;
  for (const ExrInfo::Part& part : file.parts) {
    const std::string view = part.view.empty() ? view_in_name(part.name, known) : part.view;
    names.push_back({view, without_word(part.name, view)});
  }
  if (!told) find_eyes_by_letter(file, names);
  return names;
}

/// Whether a part by this name holds the picture on top: "rgba", "RGB", "rgba.main", "main".
bool is_on_top(const std::string& name) {
  if (name.empty()) return true;
  return !any_word_from_last(name, [&](size_t begin, size_t end) {
    const std::string_view word = std::string_view(name).substr(begin, end - begin);
    return !(alike(word, "rgba") || alike(word, "rgb") || alike(word, "main"));
  });
}

struct Placed {
  size_t view, channel;
  std::string name, with_part;
};

std::vector<ExrView> views_of_several_parts(const ExrInfo& file) {
  const std::vector<PartName> parts = names_of_parts(file);
  std::set<std::string> distinct;
  for (const PartName& part : parts)
    if (!part.view.empty()) distinct.insert(part.view);
  std::vector<ExrView> views;
  const auto index_of = [&](const std::string& view) {
    const std::string name = distinct.size() < 2 ? "" : view;
    const auto it = std::find_if(views.begin(), views.end(), [&](const ExrView& v) { return v.name == name; });
    if (it != views.end()) return static_cast<size_t>(it - views.begin());
    views.push_back({name, {}});
    return views.size() - 1;
  };
  std::map<size_t, std::set<size_t>> on_top;  // parts, by view
  for (size_t p = 0; p < parts.size(); ++p)
    if (!file.parts[p].deep() && is_on_top(parts[p].stem)) on_top[index_of(parts[p].view)].insert(p);
  std::vector<Placed> placed;
  std::map<std::pair<size_t, std::string>, int> count;
  for (size_t c = 0; c < file.channels.size(); ++c) {
    const ExrInfo::Channel& channel = file.channels[c];
    const PartName& part = parts[channel.part];
    const size_t view = index_of(part.view);
    const size_t dot = channel.own.rfind('.');
    const std::string leaf = channel.own.substr(dot + 1);
    std::string layer = dot == std::string::npos ? "" : without_word(channel.own.substr(0, dot), part.view);
    if (!layer.empty()) layer += '.';
    const bool top = on_top.contains(view) && on_top.at(view) == std::set<size_t>{channel.part};
    const std::string stem = top || part.stem.empty() ? "" : part.stem + ".";
    const std::string with_part = layer.starts_with(stem) ? layer : stem + layer;
    placed.push_back({view, c, (layer.empty() ? stem : layer) + leaf, with_part + leaf});
    ++count[{view, placed.back().name}];
  }
  // One channel name in several parts: the parts' names tell them apart.
  std::map<std::pair<size_t, std::string>, int> again;
  for (Placed& p : placed) {
    if (count.at({p.view, p.name}) > 1) p.name = p.with_part;
    ++again[{p.view, p.name}];
  }
  for (const Placed& p : placed) {
    const ExrInfo::Channel& channel = file.channels[p.channel];
    const bool unique = again.at({p.view, p.name}) == 1;
    views[p.view].channels.push_back({unique ? p.name : channel.name, channel.name, channel.type});
  }
  return views;
}

std::vector<ExrView> views_of_one_part(const ExrInfo& file) {
  std::vector<ExrView> views;
  for (const std::string& name : file.views) views.push_back({name, {}});
  for (const ExrInfo::Channel& channel : file.channels) {
    std::vector<std::string> words = split(channel.name, '.');
    size_t view = 0;  // what names none belongs to the default one
    for (size_t w = words.size() - 1; w-- > 0;) {
      const auto it = std::find_if(views.begin(), views.end(), [&](const ExrView& v) { return v.name == words[w]; });
      if (it == views.end()) continue;
      view = static_cast<size_t>(it - views.begin());
      words.erase(words.begin() + static_cast<std::ptrdiff_t>(w));
      break;
    }
    views[view].channels.push_back({join(words, "."), channel.name, channel.type});
  }
  return views;
}

}  // namespace

std::vector<ExrView> views_of(const ExrInfo& file) {
  std::vector<ExrView> views;
  if (file.parts.size() > 1)
    views = views_of_several_parts(file);
  else if (file.views.size() > 1)
    views = views_of_one_part(file);
  std::erase_if(views, [](const ExrView& v) { return v.channels.empty(); });
  if (!views.empty()) return views;
  ExrView all;
  for (const ExrInfo::Channel& c : file.channels) all.channels.push_back({c.name, c.name, c.type});
  return {all};
}

}  // namespace brume
