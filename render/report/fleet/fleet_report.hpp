#pragma once

#include <filesystem>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/page/illustrated.hpp>
#include <tribotwin/twin/diagnosis/fleet/overview/overview.hpp>

namespace tribotwin::render {

struct FleetOptions {
  twin::diagnosis::fleet::SurveyOptions survey;
  std::size_t shown = 8;  ///< listed joints with figures
};

/// The verdicts on a plant, as tribotwin fleet check and watch give them for the same options.
struct FleetData {
  std::filesystem::path store;
  FleetOptions options;
  twin::diagnosis::fleet::Overview overview;
  struct Entry {
    twin::diagnosis::fleet::Listed listed;  ///< of check, or of watch alone
    bool by_check = false, by_watch = false;
  };
  std::vector<Entry> listed;                            ///< of both, by falling rank
  std::vector<twin::diagnosis::fleet::Detail> details;  ///< of the first ones
};

/// Fails, naming the store, where tribotwin fleet check would refuse.
Result<FleetData> load_fleet(const std::filesystem::path& store, const FleetOptions& options);

/// One self-contained page: how many joints need a look, the ranked list with advice, features and CUSUM of the first
/// ones, the plant at a glance, what was judged. Fails where figures cannot be drawn at all (no gnuplot).
Result<Report> make_fleet_report(const FleetData& data, const ReportOptions& options);

}  // namespace tribotwin::render
