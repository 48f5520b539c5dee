#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace brume {

/// The shortest candidate that `word` (three letters or more) is the beginning of, else the one that is fewest edits
/// away, both without case; empty when none is close enough to be meant.
std::string nearest_name(std::string_view word, std::span<const std::string> candidates);

/// "; did you mean X? Known: A, B, C", for the end of an error message.
std::string suggestion(std::string_view word, std::span<const std::string> candidates);

/// A word that a shell takes as it is, in quotes where it needs them.
std::string shell_word(const std::string& text);

/// In double quotes, with a backslash before quotes and backslashes: a string of Python, or a value of Slurm.
std::string quoted(const std::string& text);
/// A to Z made small.
std::string lower(std::string text);
/// With all that says `what` saying `by`.
std::string replaced(std::string text, std::string_view what, std::string_view by);

std::string join(std::span<const std::string> words, std::string_view separator = ", ");
std::vector<std::string> split(std::string_view text, char separator);

}  // namespace brume
