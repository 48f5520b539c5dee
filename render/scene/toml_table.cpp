#include "render/scene/toml_table.h"

#include "base/error.h"

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

std::string toml_range_text(const Field& field) {
  if (field.lowest == -kInfinity && field.highest == kInfinity) return "";
  if (field.highest == kInfinity) return fmt::format(", at least {}", field.lowest);
  return fmt::format(" in {} .. {}", field.lowest, field.highest);
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

}  // namespace brume
