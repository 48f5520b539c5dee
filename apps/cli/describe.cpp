#include "apps/cli/describe.h"

#include <fmt/format.h>

#include <vector>

#include "base/text.h"
#include "completion_bash_in.h"
#include "completion_zsh_in.h"
#include "filters/api/registry.h"
#include "workflows/version.h"

namespace brume::app {
namespace {

/// An option, or a positional argument, as all the shells need it.
struct Word {
  std::vector<std::string> names;  ///< with their dashes; none for a positional argument
  std::string description, type;   ///< no type for a flag
  std::vector<std::string> choices;
  bool required = false;
};

/// The choices that CLI::IsMember writes into a type: "TEXT:{all,indirect,apart}".
std::vector<std::string> choices_of(const CLI::Option& option) {
  if (option.check_lname("filter") || option.check_lname("clean-filter")) {
    std::vector<std::string> names;
    for (const FilterEntry* filter : filters_by_merit()) names.push_back(filter->name);
    return names;
  }
  const std::string type = option.get_type_name();
  const size_t open = type.find('{'), close = type.find('}');
  if (open == std::string::npos || close == std::string::npos || close < open) return {};
  return split(type.substr(open + 1, close - open - 1), ',');
}

Word word_of(const CLI::Option& option) {
  Word word;
  for (const std::string& name : option.get_snames()) word.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) word.names.push_back("--" + name);
  word.description = option.get_description();
  // "INT:INT in [0 - 4096]": what a check adds says it all.
  if (option.get_items_expected_max() != 0) word.type = option.get_type_name();
  if (const size_t check = word.type.find(':'); check != std::string::npos) word.type.erase(0, check + 1);
  word.choices = choices_of(option);
  word.required = option.get_required();
  if (word.names.empty()) word.type = option.get_name(/*positional=*/true);
  return word;
}

struct Verb {
  std::string name, description, footer;
  std::vector<Word> options, arguments;
};

std::vector<Verb> verbs_of(const CLI::App& app) {
  std::vector<Verb> verbs;
  for (const CLI::App* command : app.get_subcommands({})) {
    Verb& verb =
        verbs.emplace_back(Verb{command->get_name(), command->get_description(), command->get_footer(), {}, {}});
    for (const CLI::Option* option : command->get_options()) {
      Word word = word_of(*option);
      (word.names.empty() ? verb.arguments : verb.options).push_back(std::move(word));
    }
  }
  return verbs;
}

std::string roff(const std::string& text) {
  std::string result;
  for (const std::string& line : split(replaced(replaced(text, "\\", "\\e"), "-", "\\-"), '\n'))
    result += (line.starts_with('.') || line.starts_with('\'') ? "\\&" : "") + line + "\n";
  return result;
}

std::string man_entry(const Word& word) {
  const std::string name = word.names.empty() ? word.type : join(word.names);
  const std::string value = word.names.empty() || word.type.empty() ? "" : " \\fI" + word.type + "\\fR";
  return ".TP\n" + replaced(fmt::format("\\fB{}\\fR{}\n", name, value), "-", "\\-") + roff(word.description);
}

/// A text with its places filled in.
std::string filled(std::string_view text, const std::vector<std::pair<const char*, std::string>>& places) {
  std::string result(text);
  for (const auto& [place, value] : places) result = replaced(std::move(result), place, value);
  return result;
}

std::string bash_completion(const std::vector<Verb>& verbs) {
  std::vector<std::string> names;
  std::string values, options, arguments;
  for (const Verb& verb : verbs) {
    names.push_back(verb.name);
    std::vector<std::string> all;
    for (const Word& option : verb.options) {
      std::vector<std::string> patterns;
      for (const std::string& name : option.names) patterns.push_back(fmt::format("'{} {}'", verb.name, name));
      all.insert(all.end(), option.names.begin(), option.names.end());
      if (!option.choices.empty())
        values += fmt::format("    {}) words='{}' ;;\n", join(patterns, "|"), join(option.choices, " "));
      else if (!option.type.empty())
        values += fmt::format("    {}) return ;;\n", join(patterns, "|"));
    }
    options += fmt::format("      {}) words='{}' ;;\n", verb.name, join(all, " "));
    for (const Word& argument : verb.arguments)
      if (!argument.choices.empty())
        arguments += fmt::format("      {}) words='{}' ;;\n", verb.name, join(argument.choices, " "));
  }
  return filled(
      embedded::completion_bash_in,
      {{"@VERBS@", join(names, " ")}, {"@VALUES@", values}, {"@OPTIONS@", options}, {"@ARGUMENTS@", arguments}});
}

std::string zsh_text(const std::string& text) {
  std::string result = replaced(text, "\\", "\\\\");
  for (const char* special : {"[", "]", ":"}) result = replaced(result, special, std::string("\\") + special);
  return replaced(result, "'", "'\\''");
}

std::string zsh_completion(const std::vector<Verb>& verbs) {
  std::string names, cases;
  for (const Verb& verb : verbs) {
    names += fmt::format("    '{}:{}'\n", verb.name, zsh_text(verb.description));
    cases += fmt::format("    {})\n      _arguments \\\n", verb.name);
    for (const Word& option : verb.options)
      for (const std::string& name : option.names) {
        const std::string action = option.type.empty()      ? ""
                                   : option.choices.empty() ? ":value:_files"
                                                            : fmt::format(":value:({})", join(option.choices, " "));
        cases += fmt::format("        '*{}[{}]{}' \\\n", name, zsh_text(option.description), action);
      }
    std::vector<std::string> choices;
    for (const Word& argument : verb.arguments)
      choices.insert(choices.end(), argument.choices.begin(), argument.choices.end());
    cases += choices.empty() ? "        '*:file:_files'\n" : fmt::format("        '*:word:({})'\n", join(choices, " "));
    cases += "      ;;\n";
  }
  return filled(embedded::completion_zsh_in, {{"@VERBS@", names}, {"@CASES@", cases}});
}

std::string fish_text(const std::string& text) {
  return replaced(replaced(text, "\\", "\\\\"), "'", "\\'");
}

std::string fish_completion(const std::vector<Verb>& verbs) {
  std::string text = "# fish completion of brume\n";
  for (const Verb& verb : verbs) {
    text += fmt::format("complete -c brume -n __fish_use_subcommand -f -a {} -d '{}'\n", verb.name,
                        fish_text(verb.description));
    const std::string here = fmt::format("complete -c brume -n '__fish_seen_subcommand_from {}'", verb.name);
    for (const Word& option : verb.options) {
      std::string names;
      for (const std::string& name : option.names)
        names += name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1);
      const std::string value = option.type.empty()      ? ""
                                : option.choices.empty() ? " -r"
                                                         : fmt::format(" -x -a '{}'", join(option.choices, " "));
      text += fmt::format("{}{}{} -d '{}'\n", here, names, value, fish_text(option.description));
    }
    for (const Word& argument : verb.arguments)
      if (!argument.choices.empty()) text += fmt::format("{} -f -a '{}'\n", here, join(argument.choices, " "));
  }
  return text;
}

}  // namespace

std::string man_page(const CLI::App& app) {
  std::string text = fmt::format(".TH BRUME 1 \"\" \"brume {}\"\n.SH NAME\nbrume \\- {}", version_number(),
                                 roff(app.get_description()));
  text += ".SH SYNOPSIS\n.B brume\n\\fICOMMAND\\fR [\\fIOPTION\\fR...]\n.SH COMMANDS\n";
  for (const Verb& verb : verbs_of(app)) {
    std::string arguments;
    for (const Word& argument : verb.arguments)
      arguments += argument.required ? " " + argument.type : " [" + argument.type + "]";
    text += fmt::format(".SS brume {}{} [OPTION...]\n", verb.name, replaced(arguments, "-", "\\-")) +
            roff(verb.description);
    for (const Word& word : verb.arguments) text += man_entry(word);
    for (const Word& word : verb.options) text += man_entry(word);
    if (!verb.footer.empty()) text += ".PP\n.nf\n" + roff(verb.footer) + ".fi\n";
  }
  return text;
}

std::string completions(const CLI::App& app, const std::string& shell) {
  const std::vector<Verb> verbs = verbs_of(app);
  return shell == "bash" ? bash_completion(verbs) : shell == "zsh" ? zsh_completion(verbs) : fish_completion(verbs);
}

}  // namespace brume::app
