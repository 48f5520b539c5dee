#include "render/scene/toml_table.h"

#include <cstdlib>
#include <sstream>

#include "base/error.h"
#include "base/text.h"
#include "base/toml_text.h"

namespace brume {

void fail_at(const std::string& message, const toml::value& at, const std::string& expected) {
  std::string text = toml::format_error(message, at, expected);
  if (text.starts_with("[error] ")) text.erase(0, 8);
  throw InputError(text);
}

const char* toml_type_name(const toml::value& v) {
  switch (v.type()) {
    case toml::value_t::boolean:
      return "a boolean";
    case toml::value_t::integer:
      return "an integer";
    case toml::value_t::floating:
      return "a number";
    case toml::value_t::string:
      return "text";
    case toml::value_t::array:
      return "an array";
    case toml::value_t::table:
      return "a table";
    default:
      return "a date or time";
  }
}

std::string toml_text(const toml::value& v) {
  std::vector<std::string> parts;
  switch (v.type()) {
    case toml::value_t::string:
      return toml_string(toml::get<std::string>(v));
    case toml::value_t::floating:
      return toml_number(v.as_floating());
    case toml::value_t::array:
      for (const toml::value& part : v.as_array()) parts.push_back(toml_text(part));
      return "[" + join(parts) + "]";
    case toml::value_t::table:
      for (const auto& [key, part] : v.as_table())
        parts.push_back(fmt::format("{} = {}", toml_key(key), toml_text(part)));
      return "{" + join(parts) + "}";
    default:
      return toml::format(v);
  }
}

std::string toml_range_text(const Field& field) {
  if (field.lowest == -kInfinity && field.highest == kInfinity) return "";
  if (field.highest == kInfinity) return fmt::format(", at least {}", field.lowest);
  return fmt::format(" in {} .. {}", field.lowest, field.highest);
}

TomlPlace toml_place(const toml::value& value) {
  const toml::source_location at = value.location();
#if TOML11_VERSION_MAJOR >= 4
  return {at.first_line_number(), at.first_column_number(), at.length()};
#else
  return {at.line(), at.column(), at.region()};
#endif
}

toml::value parse_toml(std::istream& stream, const std::string& name) {
  try {
    return toml::parse(stream, name);
  } catch (const toml::syntax_error& error) {
    std::string text = error.what();
    if (text.starts_with("[error] ")) text.erase(0, 8);
    throw InputError(text);
  } catch (const std::bad_alloc& error) {
    fail_reading(name, error);
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: {}", name, error.what()));
  }
}

void apply_assignment(toml::value& root, const std::string& assignment) {
  const std::string source = "-D " + assignment;
  const size_t equals = assignment.find('=');
  if (equals == std::string::npos || equals == 0)
    throw InputError(fmt::format("{}: expected -D table.key=value", source));
  const std::string text = assignment.substr(equals + 1);
  toml::value value;
  try {
    std::istringstream stream("value = " + text);
    value = parse_toml(stream, source).at("value");
  } catch (const InputError&) {
    // Text without its quotes.
    for (const char quote : {'"', '\''})
      if (text.size() > 1 && text.front() == quote && text.back() == quote) throw;
    std::istringstream stream("value = " + toml_string(text));
    value = parse_toml(stream, source).at("value");
  }
  // What is made on the way has a place, too, for messages about it.
  const auto made = [&](const char* empty) {
    std::istringstream stream(std::string("value = ") + empty);
    return parse_toml(stream, source).at("value");
  };
  toml::value* at = &root;
  const std::vector<std::string> keys = split(assignment.substr(0, equals), '.');
  for (size_t i = 0; i < keys.size(); ++i) {
    const std::string& key = keys[i];
    if (at->is_array()) {
      char* end = nullptr;
      toml::array& entries = at->as_array();
      const size_t index = std::strtoul(key.c_str(), &end, 10);
      if (*end != '\0' || key.empty() || index > entries.size())
        throw InputError(
            fmt::format("{}: '{}' is not one of the {} entries, counted from 0", source, key, entries.size()));
      if (index == entries.size()) entries.push_back(made("{}"));
      at = &entries[index];
    } else if (at->is_table()) {
      const bool of_list = i + 1 < keys.size() && keys[i + 1].find_first_not_of("0123456789") == std::string::npos;
      at = &at->as_table().try_emplace(key, made(of_list ? "[]" : "{}")).first->second;
    } else {
      throw InputError(fmt::format("{}: '{}' is inside {}, not a table", source, key, toml_type_name(*at)));
    }
  }
  *at = value;
}

}  // namespace brume
