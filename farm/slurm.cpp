#include "farm/slurm.h"

#include <fmt/format.h>
#include <sys/wait.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "base/error.h"
#include "base/output_file.h"
#include "base/text.h"
#include "task_sh_in.h"

namespace brume {
namespace {

namespace fs = std::filesystem;

struct Output {
  int status = -1;
  std::string text;
};

/// Runs a shell command and reads what it prints.
Output output_of(const std::string& command) {
  Output output;
  FILE* const pipe = popen(command.c_str(), "r");
  if (!pipe) return output;
  std::array<char, 4096> buffer{};
  for (size_t n; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;) output.text.append(buffer.data(), n);
  const int status = pclose(pipe);
  output.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  while (!output.text.empty() && output.text.back() == '\n') output.text.pop_back();
  return output;
}

/// An option as it was given: with quotes or backslashes as a line of #SBATCH, else as a word of a shell.
std::string sbatch_option(const std::string& option) {
  const size_t equals = option.find('=');
  if (!option.starts_with("--") || equals == std::string::npos || option.find_first_of("\"'\\") != std::string::npos ||
      option.find_first_of(" \t#") == std::string::npos)
    return option;
  return option.substr(0, equals + 1) + quoted(option.substr(equals + 1));
}

/// A folder in the name of a log, where %a stands for the number of a task.
std::string log_folder(const fs::path& folder) {
  return replaced(folder.string(), "%", "%%");
}

std::string directives(const Shot& shot, const std::string& stage, const fs::path& round, const SlurmOptions& options) {
  std::string text = "#!/bin/sh\n";
  const auto add = [&](const std::string& option) { text += "#SBATCH " + option + "\n"; };
  add("--job-name=" + quoted(shot.name + "." + stage));
  add("--open-mode=append");
  add("--output=" + quoted(fmt::format("{}/{}.log", log_folder(round), stage == "retry" ? stage : stage + ".%a")));
  if (!options.exclude.empty()) {
    const std::vector<std::string> nodes(options.exclude.begin(), options.exclude.end());
    add("--exclude=" + join(nodes, ","));
  }
  for (const std::string& option : options.sbatch) add(sbatch_option(option));
  return text;
}

std::string array_script(const Shot& shot, const SlurmJob& job, const fs::path& round, const SlurmOptions& options) {
  std::string text = directives(shot, job.stage, round, options);
  const auto add = [&](const std::string& option) { text += "#SBATCH " + option + "\n"; };
  add(fmt::format("--array=0-{}{}", job.tasks - 1, options.at_once > 0 ? fmt::format("%{}", options.at_once) : ""));
  add("--time=" + options.time);
  add("--requeue");
  add(fmt::format("--signal=B:USR1@{}", options.warning_seconds));
  add("--ntasks=1");
  add(shot.threads > 0 ? fmt::format("--cpus-per-task={}", shot.threads) : "--exclusive");
  // The folder last: it may hold anything.
  std::string script(embedded::task_sh_in);
  for (const auto& [place, value] : {std::pair("@COMMANDS@", std::to_string(job.commands)),
                                     {"@TASKS@", std::to_string(job.tasks)},
                                     {"@CHUNK@", std::to_string(job.chunk)},
                                     {"@STAGE@", job.stage},
                                     {"@ROUND@", shell_word(round.string())}})
    script = replaced(script, place, value);
  return text + script;
}

/// The job that looks at what is there and submits what is not.
SlurmJob retry_job(const Shot& shot, const fs::path& round, const SlurmOptions& options) {
  std::string text = directives(shot, "retry", round, options);
  text += "#SBATCH --ntasks=1\n#SBATCH --requeue\n";
  text += fmt::format(
      "\n# What is missing or damaged is submitted again, without the nodes on which most failed. Begun once more after\n"
      "# its node has died, it finds its own lock.\n"
      "{} submit resume {} --retries {} --after {} ${{SLURM_RESTART_COUNT:+--break-lock}}\n",
      shell_word(shot.brume), shell_word(shot.folder.string()), options.retries - 1, round.filename().string());
  SlurmJob job;
  job.stage = "retry";
  job.script = text;
  return job;
}

/// Whether Slurm only has to tidy up after a task in this state.
bool is_over(const std::string& state) {
  static const std::set<std::string> over = {"BOOT_FAIL", "CANCELLED", "COMPLETED",     "COMPLETING",
                                             "DEADLINE",  "FAILED",    "NODE_FAIL",     "PREEMPTED",
                                             "REVOKED",   "TIMEOUT",   "OUT_OF_MEMORY", "SPECIAL_EXIT"};
  return over.contains(state);
}

template <class Options, class Visitor>
void each_option(Options& options, Visitor&& visit) {
  visit("sbatch", options.sbatch);
  visit("time", options.time);
  visit("tasks", options.most_tasks);
  visit("at_once", options.at_once);
  visit("warning", options.warning_seconds);
  visit("retries", options.retries);
}

}  // namespace

void SlurmOptions::save(const Shot& shot) const {
  nlohmann::json j;
  each_option(*this, [&](const char* key, const auto& value) { j[key] = value; });
  write_text(shot.folder / "slurm.json", j.dump(2) + "\n");
}

SlurmOptions SlurmOptions::load(const Shot& shot) {
  SlurmOptions options;
  const fs::path file = shot.folder / "slurm.json";
  std::ifstream stream(file);
  if (!stream) return options;
  try {
    const nlohmann::json j = nlohmann::json::parse(stream);
    each_option(options, [&](const char* key, auto& value) { j.at(key).get_to(value); });
  } catch (const nlohmann::json::exception& error) {
    throw InputError(fmt::format("{}: damaged: {}", file.string(), error.what()));
  }
  return options;
}

void check_slurm(const Shot& shot, const SlurmOptions& options) {
  // A backslash anywhere in the name of a log tells Slurm to replace nothing, so that all tasks would write to one.
  if (shot.folder.string().find('\\') != std::string::npos)
    throw InputError(
        fmt::format("{}: Slurm cannot write logs to a folder with a backslash in its name; expected one without",
                    shot.folder.string()));
  check_one_line("--time", options.time);
  for (const std::string& option : options.sbatch) {
    check_one_line("--sbatch", option);
    if (!option.starts_with('-'))
      throw InputError(
          fmt::format("--sbatch {}: expected an option of sbatch, as --sbatch=--partition=render", option));
  }
}

std::vector<SlurmJob> slurm_jobs(const Shot& shot, const std::vector<Stage>& stages, const fs::path& round,
                                 const SlurmOptions& options) {
  std::vector<SlurmJob> jobs;
  for (const Stage& stage : stages) {
    SlurmJob job;
    job.stage = stage.name;
    job.commands = static_cast<int>(stage.commands.size());
    job.chunk = (job.commands + options.most_tasks - 1) / options.most_tasks;
    job.tasks = (job.commands + job.chunk - 1) / job.chunk;
    job.script = array_script(shot, job, round, options);
    jobs.push_back(std::move(job));
  }
  if (options.retries > 0 && !jobs.empty()) jobs.push_back(retry_job(shot, round, options));
  return jobs;
}

std::vector<std::string> sbatch_lines(const std::vector<SlurmJob>& jobs, const fs::path& round) {
  std::vector<std::string> lines;
  std::string before;
  for (const SlurmJob& job : jobs) {
    lines.push_back(fmt::format("{}=$(sbatch --parsable{} {})", job.stage,
                                before.empty() ? "" : fmt::format(" --dependency=afterany:${}", before),
                                shell_word((round / (job.stage + ".sh")).string())));
    before = job.stage;
  }
  return lines;
}

std::map<std::string, std::string> submit_to_slurm(const std::vector<SlurmJob>& jobs, const fs::path& round) {
  std::map<std::string, std::string> numbers;
  std::string before, record;
  for (const SlurmJob& job : jobs) write_text(round / (job.stage + ".sh"), job.script);
  for (const SlurmJob& job : jobs) {
    const std::string command =
        fmt::format("sbatch --parsable{} {} 2>&1", before.empty() ? "" : " --dependency=afterany:" + before,
                    shell_word((round / (job.stage + ".sh")).string()));
    const Output output = output_of(command);
    // The last line is "NUMBER" or "NUMBER;CLUSTER"; warnings may stand before it.
    const std::string last = output.text.substr(output.text.rfind('\n') + 1);
    before = last.substr(0, last.find(';'));
    if (output.status != 0 || before.empty() || before.find_first_not_of("0123456789") != std::string::npos) {
      std::string cancel;
      for (const auto& [stage, number] : numbers) cancel += " " + number;
      throw InputError(fmt::format("sbatch did not take {}: {}{}", (round / (job.stage + ".sh")).string(),
                                   output.text.empty() ? "is Slurm installed here?" : output.text,
                                   cancel.empty() ? "" : fmt::format("; what it took: scancel{}", cancel)));
    }
    numbers[job.stage] = before;
    record += fmt::format("{} {} {}\n", job.stage, before, job.chunk);
    write_text(round / "jobs", record);
  }
  return numbers;
}

SlurmQueue ask_slurm(const Shot& shot) {
  SlurmQueue queue;
  for (int number = 1; number <= last_round(shot); ++number) {
    const fs::path round = shot.folder / "rounds" / std::to_string(number);
    std::ifstream jobs(round / "jobs");
    std::string stage, id;
    for (int chunk; jobs >> stage >> id >> chunk;) {
      // A number that Slurm has forgotten is an error that says so: nothing of it is left to do.
      const Output output = output_of(fmt::format("squeue -h -r -j {} -o '%K %T' 2>&1", id));
      const bool forgotten = output.text.find("Invalid job id") != std::string::npos;
      if (output.status != 0 && !forgotten) return queue;
      queue.known = true;
      if (stage == "retry") continue;
      std::vector<std::string> names;
      std::ifstream commands(round / (stage + ".commands"));
      for (std::string line; std::getline(commands, line);) names.push_back(line.substr(0, line.find('\t')));
      for (const std::string& name : names) queue.over[name] = id;
      if (forgotten) continue;
      std::istringstream tasks(output.text);
      bool at_work = false;
      std::string state;
      for (size_t task; tasks >> task >> state;) {
        if (is_over(state)) continue;
        at_work = true;
        const size_t first = task * static_cast<size_t>(chunk), end = first + static_cast<size_t>(chunk);
        for (size_t i = first; i < std::min(names.size(), end); ++i) {
          queue.states[names[i]] = state;
          queue.over.erase(names[i]);
        }
      }
      if (at_work) queue.jobs.push_back(id);
    }
  }
  return queue;
}

std::set<std::string> failing_nodes(const Shot& shot, int round) {
  std::map<std::string, int> balance;  // ended well minus failed
  std::error_code error;
  const fs::path folder = shot.folder / "rounds" / std::to_string(round);
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end; entry.increment(error)) {
    if (entry->path().extension() != ".commands") continue;
    std::ifstream commands(entry->path());
    for (std::string line; std::getline(commands, line);)
      for (const Attempt& attempt : read_log(shot, line.substr(0, line.find('\t'))).attempts)
        if (attempt.round == round && attempt.status) balance[attempt.node] += *attempt.status == 0 ? 1 : -1;
  }
  std::set<std::string> failing;
  for (const auto& [node, sum] : balance)
    if (sum < 0) failing.insert(node);
  return failing.size() == balance.size() ? std::set<std::string>() : failing;
}

}  // namespace brume
