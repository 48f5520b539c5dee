#include "apps/cli/arguments.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <map>

#include "base/error.h"
#include "base/text.h"

namespace brume::app {
namespace {

bool is_long_option(const std::string& word) {
  return word.starts_with("--") && word.size() > 2;
}

// What other programs call options of ours.
const std::map<std::string, std::vector<std::string>, std::less<>> kNamesElsewhere = {
    {"spp", {"samples", "sample-count", "num-samples", "paths"}},
    {"size", {"resolution", "width", "height", "dimensions"}},
    {"clean", {"denoise", "denoiser"}},
    {"output", {"out", "output-file"}},
    {"threads", {"num-threads", "nthreads", "cores", "jobs"}},
    {"crop", {"region", "border", "cropwindow", "window"}},
    {"layers", {"aovs", "passes", "channels"}},
    {"quiet", {"silent"}}};

/// The option of that meaning, "" where there is none.
std::string option_called_elsewhere(std::string_view name, const std::vector<std::string>& options) {
  for (const auto& [own, others] : kNamesElsewhere)
    if (std::find(others.begin(), others.end(), name) != others.end() &&
        std::find(options.begin(), options.end(), own) != options.end())
      return own;
  return {};
}

/// "render has no option '--ssp'; did you mean '--spp'?"
/// @param word  as typed, with its dashes and perhaps "=value"
std::string no_option(const CLI::App& verb, const std::string& word) {
  std::vector<std::string> options;
  for (const CLI::Option* option : verb.get_options())
    for (const std::string& name : option->get_lnames()) options.push_back(name);
  const std::string name = word.substr(2, word.find('=') - 2), same = option_called_elsewhere(name, options),
                    nearest = same.empty() ? nearest_name(name, options) : same;
  return fmt::format("{} has no option '--{}'{}", verb.get_name(), name,
                     nearest.empty() ? "" : fmt::format("; did you mean '--{}'?", nearest));
}

std::string without_leading_zeros(std::string text) {
  const size_t first = text.starts_with("-") || text.starts_with("+") ? 1 : 0;
  while (text.size() > first + 1 && text[first] == '0' && std::isdigit(static_cast<unsigned char>(text[first + 1])))
    text.erase(first, 1);
  return text;
}

/// Gathers the filters of one command line, each with what follows it.
class FilterWords {
 public:
  explicit FilterWords(const CLI::App& verb) : verb_(verb) {}

  /// Takes the word at `i`, and the next where it is its value. @return false where it is not about filters
  bool take(const std::vector<std::string>& words, size_t& i) {
    const std::string& word = words[i];
    if (word == "-f" || word == "--filter") {
      if (i + 1 == words.size()) return false;  // CLI11 says what is missing
      filters_.push_back(words[++i]);
    } else if (word.starts_with("--filter=")) {
      filters_.push_back(word.substr(word.find('=') + 1));
    } else if (word.starts_with("-f") && !word.starts_with("--")) {
      filters_.push_back(word.substr(word[2] == '=' ? 3 : 2));
    } else if (is_long_option(word)) {
      std::string name = word.substr(2, word.find('=') - 2);
      if (verb_.get_option_no_throw("--" + name)) return false;
      take_parameter(name, words, i);
    } else {
      return false;
    }
    return true;
  }

  /// "-f", "NAME:parameter=value,...", for each.
  /// @throws InputError for parameters without a filter
  std::vector<std::string> words() const {
    if (filters_.empty() && !common_.empty()) refuse_parameter_without_filter();
    std::vector<std::string> words;
    for (size_t f = 0; f < filters_.size(); ++f) {
      std::vector<std::string> parameters = common_;
      const size_t colon = filters_[f].find(':');
      if (colon != std::string::npos) parameters.push_back(filters_[f].substr(colon + 1));
      if (f < own_.size()) parameters.insert(parameters.end(), own_[f].begin(), own_[f].end());
      words.push_back("-f");
      words.push_back(filters_[f].substr(0, colon) + (parameters.empty() ? "" : ":" + join(parameters, ",")));
    }
    return words;
  }

 private:
  void take_parameter(const std::string& name, const std::vector<std::string>& words, size_t& i) {
    std::string value;
    if (const size_t equals = words[i].find('='); equals != std::string::npos)
      value = words[i].substr(equals + 1);
    else if (i + 1 < words.size() && !is_long_option(words[i + 1]))
      value = words[++i];
    else
      refuse_parameter_without_value(name);
    own_.resize(filters_.size());
    (filters_.empty() ? common_ : own_.back()).push_back(name + "=" + value);
  }
  [[noreturn]] void refuse_parameter_without_value(const std::string& name) const {
    const std::string said = no_option(verb_, "--" + name);
    if (filters_.empty()) throw InputError(said);
    throw InputError(fmt::format("--{} has no value; it follows -f {} and is read as its parameter: {}", name,
                                 filters_.back(), said));
  }
  [[noreturn]] void refuse_parameter_without_filter() const {
    const std::string word = "--" + common_[0].substr(0, common_[0].find('='));
    throw InputError(fmt::format("{}; the parameter of a filter follows its filter: -f NAME {} VALUE",
                                 no_option(verb_, word), word));
  }

  const CLI::App& verb_;
  std::vector<std::string> filters_, common_;
  std::vector<std::vector<std::string>> own_;  // of each filter
};

}  // namespace

std::vector<std::string> arrange(const CLI::App& app, const std::vector<std::string>& words) {
  if (!words.empty() && words[0] == "help")  // help render: render --help
    return words.size() < 2 ? std::vector<std::string>{"--help"} : std::vector<std::string>{words[1], "--help"};
  const std::vector<const CLI::App*> verbs =
      app.get_subcommands([&](const CLI::App* verb) { return !words.empty() && verb->get_name() == words[0]; });
  if (verbs.empty()) return words;
  const CLI::App* verb = verbs[0];
  const bool has_filters = verb->get_option_no_throw("--filter") != nullptr;
  FilterWords filters(*verb);
  std::vector<std::string> result = {words[0]};
  bool options_end = false;  // after --, words are files
  for (size_t i = 1; i < words.size(); ++i) {
    options_end |= words[i] == "--";
    if (has_filters && !options_end && filters.take(words, i)) continue;
    if (!options_end && is_long_option(words[i]) && !verb->get_option_no_throw(words[i].substr(0, words[i].find('='))))
      throw InputError(no_option(*verb, words[i]));
    const bool scene_follows = i + 1 < words.size() && words[i + 1].ends_with(".toml");
    const bool file_follows = i + 1 < words.size() && words[i + 1].ends_with(".exr");
    // Their values may be left out.
    if (words[i] == "--tev" && scene_follows)
      result.push_back("--tev=default");
    else if (words[i] == "--resume" && !file_follows && words[0] == "render")
      result.push_back("--resume=frames");
    else
      result.push_back(words[i]);
  }
  const std::vector<std::string> arranged = filters.words();
  result.insert(result.begin() + 1, arranged.begin(), arranged.end());
  return result;
}

void read_integers_as_decimal(CLI::App& app) {
  for (CLI::App* verb : app.get_subcommands({}))
    for (CLI::Option* option : verb->get_options()) {
      const std::string type = option->get_type_name();
      if (type.starts_with("INT") || type.starts_with("UINT")) option->transform(without_leading_zeros, "");
    }
}

}  // namespace brume::app
