#pragma once
#include <string>
#include <utility>
#include <vector>

namespace brume {

/// A table of texts, to be written in any of four formats.
struct Table {
  struct Column {
    std::string title;
    bool number = true;  ///< stands at the right
  };
  std::string name;            ///< of its files
  std::string title, caption;  ///< for people; the caption may be empty
  std::vector<Column> columns;
  std::vector<std::vector<std::string>> rows;
  /// What it was made with, by name: a comment or further columns.
  std::vector<std::pair<std::string, std::string>> origin = {};

  /// The title, and the grid in columns of spaces, for a terminal.
  std::string text() const;
  /// The grid alone, as GitHub reads it.
  std::string markdown_grid() const;
  std::string markdown() const;
  /// RFC 4180; what it was made with stands in further columns, so that a row keeps it wherever it is copied.
  std::string csv() const;
  std::string latex() const;
  std::string json() const;
};

/// A field as RFC 4180 has it.
std::string csv_field(const std::string& text);

}  // namespace brume
