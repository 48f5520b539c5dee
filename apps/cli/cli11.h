#pragma once
// CLI11 as the verbs need it. Not <CLI/CLI.hpp>: every file that includes that one compiles the help formatter and the
// reader of configuration files, whose virtual functions a compiler cannot leave out. main.cpp includes them.
#include <CLI/App.hpp>
#include <string>
#include <vector>

namespace CLI {

// The options that nearly every verb has, compiled in main.cpp alone.
extern template Option* App::add_option<std::string>(std::string, std::string&, std::string);
extern template Option* App::add_option<std::vector<std::string>>(std::string, std::vector<std::string>&, std::string);
extern template Option* App::add_option<int>(std::string, int&, std::string);
extern template Option* App::add_option<double>(std::string, double&, std::string);
extern template Option* App::add_flag<bool>(std::string, bool&, std::string);

}  // namespace CLI
