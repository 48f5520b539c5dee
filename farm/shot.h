#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace brume {

/// A sequence that a farm renders: what was asked for, and where everything lies that it makes.
///
///     FOLDER/shot.json                what was asked for
///     FOLDER/parts/0017/00003.exr     a share of a frame's samples, until it is merged; its checkpoint beside it
///     FOLDER/frames/NAME.0017.exr     the frame
///     FOLDER/clean/NAME.0017.exr      the frame without noise
///     FOLDER/logs/render.0017.00003.log   what a command said, attempt after attempt
///     FOLDER/rounds/1/                the commands of one submission, and the scripts that run them
///
/// The files are the state: nothing else says what is done. Each is written aside and renamed, none is locked, and
/// times of files are never looked at.
struct Shot {
  std::filesystem::path folder;  ///< absolute; not saved
  std::string name;              ///< of the scene
  std::string program;           ///< version that renders: parts of another are not merged
  std::string brume;             ///< the program, as the nodes call it
  std::string scene;             ///< absolute path
  std::string scene_text;        ///< fingerprint of the scene file: what changes it makes another shot
  std::vector<std::string> overrides;
  std::vector<int> frames;  ///< rising
  int parts = 1;            ///< of each frame
  int spp = 0;
  int64_t seed = 0;
  std::string layers;       ///< as render --layers takes them
  std::string statistics;   ///< as headers say them: halves, buckets
  std::string filter;       ///< that cleans the frames; empty: none does
  int window = 0;           ///< frames before and after that it looks into
  int threads = 0;          ///< of each command; 0: all of the node's
  bool keep_parts = false;  ///< after they are merged

  std::filesystem::path part(int frame, int number) const;  ///< number from 1 on
  std::filesystem::path checkpoint(int frame, int number) const;
  std::filesystem::path group(int frame, int number) const;  ///< parts merged to one, where there are too many
  std::filesystem::path frame(int frame) const;
  std::filesystem::path clean(int frame) const;
  std::filesystem::path log(const std::string& command) const;

  /// Parts that one merge reads. More are merged in groups first.
  static constexpr int kMostMerged = 64;
  /// Groups of parts, or 0 where they are merged at once.
  int groups() const;
  /// The parts of a group: [first, last].
  std::pair<int, int> parts_of_group(int group) const;

  /// The frames that a frame is cleaned with, itself included.
  std::vector<int> window_of(int frame) const;
  /// Refuses what the files, commands and scripts of the shot cannot hold. @throws InputError
  void check() const;
  /// Writes FOLDER/shot.json and makes the folders. @throws InputError
  void save() const;
  /// @throws InputError: there is none, or it is damaged
  static Shot load(const std::filesystem::path& folder);
  /// "parts is 8 there, 4 here" for what differs from another shot in the same folder; empty: nothing.
  std::string difference(const Shot& here) const;
};

/// A number that is another one for another text. Not for secrets.
std::string fingerprint(const std::string& text);

/// Refuses control characters in what stands in a script or in a list of commands, one a line: a line break would begin
/// another one. A tab is none of them.
/// @param what  that text is: "the folder"   @throws InputError
void check_one_line(const std::string& what, const std::string& text);

}  // namespace brume
