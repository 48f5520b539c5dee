#pragma once
#include <filesystem>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "farm/plan.h"

namespace brume {

/// What is asked of Slurm, beyond what the plan says.
struct SlurmOptions {
  std::vector<std::string> sbatch;  ///< options for every job: --partition=render
  std::string time = "04:00:00";    ///< limit of a task
  int most_tasks = 1000;            ///< of one array; Slurm's MaxArraySize is 1001 unless a site raises it
  int at_once = 0;                  ///< tasks of an array that run at the same time; 0: all
  int warning_seconds = 120;        ///< before the limit, for the last checkpoint
  int retries = 2;                  ///< rounds after the first for what has failed
  std::set<std::string> exclude;    ///< nodes; not saved

  /// In FOLDER/slurm.json, for what is submitted later. @throws InputError
  void save(const Shot& shot) const;
  /// Those that were saved, or the defaults. @throws InputError
  static SlurmOptions load(const Shot& shot);
};

/// Refuses what a script for sbatch cannot hold. @throws InputError
void check_slurm(const Shot& shot, const SlurmOptions& options);

/// One job of a submission.
struct SlurmJob {
  std::string stage;
  std::string script;           ///< text, for sbatch
  int commands = 0, tasks = 0;  ///< of the array; a task runs `chunk` commands
  int chunk = 1;
};

/// A job array for each stage, each after the one before, and where anything may be retried a last job that does so.
/// @param round  folder of the round (write_round)
std::vector<SlurmJob> slurm_jobs(const Shot& shot, const std::vector<Stage>& stages, const std::filesystem::path& round,
                                 const SlurmOptions& options);

/// "sbatch --parsable --dependency=afterany:$render merge.sh" for each job, as a shell reads it.
std::vector<std::string> sbatch_lines(const std::vector<SlurmJob>& jobs, const std::filesystem::path& round);

/// Writes the scripts and submits them; the jobs' numbers go to ROUND/jobs.
/// @return the numbers by stage   @throws InputError with what sbatch said
std::map<std::string, std::string> submit_to_slurm(const std::vector<SlurmJob>& jobs,
                                                   const std::filesystem::path& round);

/// Commands that Slurm has not finished with, by their state in its words: PENDING, RUNNING, ...
struct SlurmQueue {
  bool known = false;                         ///< whether Slurm could be asked
  std::vector<std::string> jobs;              ///< numbers of the arrays that are not over
  std::map<std::string, std::string> states;  ///< by the command's name
  std::map<std::string, std::string> over;    ///< of commands that Slurm has done with: the array's number
};
SlurmQueue ask_slurm(const Shot& shot);

/// Nodes on which more failed than ended well in a round, unless that is all of them.
std::set<std::string> failing_nodes(const Shot& shot, int round);

}  // namespace brume
