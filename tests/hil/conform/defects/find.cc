// Runs all checks on the drive that this program is linked with. Arguments: the check that has to fail; without one,
// none may. The failed ones are printed with their clauses.
#include <cstdio>
#include <string_view>

#include <tribotwin/hil/conform/report.hpp>
#include <tribotwin/tests/hil/conform/one_drive_bus.hpp>

int main(int argc, char** argv) {
  using namespace tribotwin::hil;
  const std::string_view wanted = argc > 1 ? argv[1] : "";
  OneDriveBus bus(test_drive());
  const auto report =
      conform(bus, test_drive().node, {.motion = true, .homing = true}, {.now_ns = [&] { return bus.now_ns(); }});
  if (!report) {
    std::printf("%s\n", report.error().message.c_str());
    return 1;
  }
  bool found = false;
  for (const Finding& f : report->findings) {
    if (f.verdict != Verdict::fail) continue;
    std::printf("%s (%s): expected %s, seen %s\n", f.check.id, f.check.clause, f.expected.c_str(), f.seen.c_str());
    found = found || f.check.id == wanted;
  }
  std::printf("%s\n", summary(*report).c_str());
  return wanted.empty() ? report->count(Verdict::fail) > 0 : !found;
}
