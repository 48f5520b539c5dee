#pragma once
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace brume {

/// A table of texts: for a terminal, as Markdown, as CSV.
struct Table {
  struct Column {
    std::string title;
    bool number = true;  ///< stands at the right
  };
  std::string title = {}, caption = {};  ///< for people; the caption may be empty
  std::vector<Column> columns = {};
  std::vector<std::vector<std::string>> rows = {};
  /// What it was made with, by name: further columns of the CSV.
  std::vector<std::pair<std::string, std::string>> origin = {};

  /// The title, and the grid in columns of spaces, for a terminal.
  std::string text() const;
  /// The grid alone, as GitHub reads it.
  std::string markdown_grid() const;
  /// RFC 4180; what it was made with stands in further columns, so that a row keeps it wherever it is copied.
  std::string csv() const;
};

/// Columns by their titles, "scene | #spp": what stands after a # are numbers.
std::vector<Table::Column> columns(std::string_view titles);

}  // namespace brume
