#pragma once

#include <functional>
#include <string>
#include <vector>

#include <tribotwin/hil/conform/checks.hpp>

/// Runs the checks against a node and reports what was found.
namespace tribotwin::hil {

enum class Verdict { pass, fail, not_applicable, not_run };
const char* name_of(Verdict verdict);

struct Finding {
  Check check;
  Verdict verdict;
  std::string expected, seen;  ///< seen: also the reason of not_applicable and not_run
};

struct ConformReport {
  std::uint8_t node;
  std::string bus;          ///< name of the transport
  std::string device_name;  ///< 1008h, "" without
  std::uint32_t device_type = 0;
  std::vector<Finding> findings;
  std::vector<std::string> notes;  ///< what could not be restored
  bool interrupted = false;
  bool without_power = true;  ///< at the end; false where the node did not obey any more

  int count(Verdict verdict) const;
};

/// Called with the number of a check, from 0, and how many there are.
using ConformProgress = std::function<void(std::size_t, std::size_t, const Check&)>;

/// Fails when no node answers (ErrorKind::work), or when the drive is enabled already. However it ends, the drive is
/// without power afterwards, its objects are restored, and the node is pre-operational or in the state in which its
/// heartbeat showed it.
Result<ConformReport> conform(Transport& bus, std::uint8_t node, const ConformOptions& options,
                              ClientOptions client = {}, const ConformProgress& progress = {});

/// Two or three lines per check, then the counts.
std::string to_text(const ConformReport& report);
std::string to_json(const ConformReport& report);
/// "131 checks: 120 passed, 0 failed, 11 not applicable, 0 not run"
std::string summary(const ConformReport& report);

}  // namespace tribotwin::hil
