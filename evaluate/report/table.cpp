#include "evaluate/report/table.h"

#include <algorithm>

#include "base/text.h"

namespace brume {
namespace {

std::string markdown_text(std::string text) {
  return replaced(std::move(text), "|", "\\|");
}

std::string csv_field(std::string text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  return "\"" + replaced(std::move(text), "\"", "\"\"") + "\"";
}

std::string line_of(const std::vector<std::string>& cells, const std::string& separator,
                    std::string (*field)(std::string)) {
  std::vector<std::string> fields;
  for (const std::string& cell : cells) fields.push_back(field(cell));
  return join(fields, separator);
}

std::vector<std::string> titles(const Table& table) {
  std::vector<std::string> list;
  for (const Table::Column& c : table.columns) list.push_back(c.title);
  return list;
}

}  // namespace

std::vector<Table::Column> columns(std::string_view titles) {
  std::vector<Table::Column> list;
  for (size_t begin = 0; begin <= titles.size();) {
    const size_t end = std::min(titles.find(" | ", begin), titles.size());
    const bool number = titles.substr(begin).starts_with('#');
    list.push_back({std::string(titles.substr(begin + number, end - begin - number)), number});
    begin = end + 3;
  }
  return list;
}

std::string Table::text() const {
  // Every character of ours is one column wide; in UTF-8 all bytes but its first begin with 10.
  const auto width_of = [](const std::string& cell) {
    return static_cast<size_t>(std::count_if(cell.begin(), cell.end(), [](char c) { return (c & 0xc0) != 0x80; }));
  };
  std::vector<std::vector<std::string>> lines = {titles(*this)};
  lines.insert(lines.end(), rows.begin(), rows.end());
  std::vector<size_t> widths(columns.size());
  for (const auto& line : lines)
    for (size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], width_of(line[c]));
  std::string all = title + "\n";
  for (const auto& line : lines) {
    std::string written;
    for (size_t c = 0; c < line.size(); ++c) {
      const std::string space(widths[c] - width_of(line[c]), ' ');
      written += (c > 0 ? "  " : "") + (columns[c].number ? space + line[c] : line[c] + space);
    }
    all += written.substr(0, written.find_last_not_of(' ') + 1) + "\n";
  }
  return all;
}

std::string Table::markdown_grid() const {
  std::string text = "| " + line_of(titles(*this), " | ", markdown_text) + " |\n|";
  for (const Column& c : columns) text += c.number ? "---:|" : "---|";
  text += "\n";
  for (const auto& row : rows) text += "| " + line_of(row, " | ", markdown_text) + " |\n";
  return text;
}

std::string Table::csv() const {
  std::vector<std::string> head = titles(*this);
  for (const auto& entry : origin) head.push_back(entry.first);
  std::string text = line_of(head, ",", csv_field) + "\n";
  for (std::vector<std::string> row : rows) {
    for (const auto& entry : origin) row.push_back(entry.second);
    text += line_of(row, ",", csv_field) + "\n";
  }
  return text;
}

}  // namespace brume
