#include <bit>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/session/statistics.hpp>

namespace tribotwin::hil {
namespace {

using Json = nlohmann::ordered_json;

double us(std::int64_t ns) { return static_cast<double>(ns) / 1000; }

Json spread(const Distribution& d) {
  return {{"median", us(d.median_ns())}, {"p99", us(d.quantile_ns(0.99))}, {"max", us(d.max_ns())}};
}

void add_sync(Json& json, const SyncTiming& sync, std::int64_t cycle_us) {
  json["cycle_us"] = cycle_us;
  if (sync.period().count() > 0) {
    json["sync_period_us"] = spread(sync.period());
    json["sync_jitter_us"] = spread(sync.period().around_median());
  }
  if (sync.latency().count() > 0) json["sync_to_tpdo_us"] = spread(sync.latency());
  if (const auto scale = sync.time_scale()) json["time_scale"] = *scale;
}

/// Lateness also as a histogram in powers of two.
void add_pace(Json& json, const Pace& pace) {
  const Distribution& late = pace.lateness();
  json["overruns"] = pace.overruns();
  json["skipped_us"] = pace.skipped_ns() / 1000;
  json["lateness_median_us"] = late.median_ns() / 1000;
  json["lateness_p99_us"] = late.quantile_ns(0.99) / 1000;
  json["lateness_max_us"] = late.max_ns() / 1000;
  std::map<std::uint64_t, std::uint64_t> below_us;
  late.each([&](std::int64_t ns, std::uint64_t times) {
    below_us[std::uint64_t{1} << std::bit_width(static_cast<std::uint64_t>(ns / 1000))] += times;
  });
  for (const auto& [limit, count] : below_us) json[fmt::format("lateness_below_{}_us", limit)] = count;
}

Json of_bus(const BusCounters& bus) {
  return {{"sent", bus.sent},
          {"received", bus.received},
          {"send_busy", bus.send_busy},
          {"send_down", bus.send_down},
          {"send_refused", bus.send_refused},
          {"receive_lost", bus.receive_lost},
          {"error_frames", bus.error_frames},
          {"bus_off", bus.bus_off},
          {"link_losses", bus.link_losses},
          {"malformed", bus.malformed}};
}

}  // namespace

std::string statistics_json(const Bench& bench, const BusCounters& bus, const SessionTiming& timing) {
  const BenchCounters& c = bench.counters();
  const auto load = [&](double bit_rate) { return timing.wall_s > 0 ? c.bits / (bit_rate * timing.wall_s) : 0; };
  Json json{{"wall_s", timing.wall_s},
            {"simulated_s", bench.plant().twin().time_s()},
            {"syncs", c.syncs},
            {"sync_fast", c.sync_fast},
            {"frames_in", c.frames_in},
            {"frames_out", c.frames_out},
            {"bus_load_1_mbit", load(1e6)}};
  if (timing.bit_rate) {
    json["bit_rate"] = std::llround(*timing.bit_rate);
    json["bus_load"] = load(*timing.bit_rate);
  }
  if (timing.sync) add_sync(json, *timing.sync, bench.cycle_us());
  if (timing.pace) add_pace(json, *timing.pace);
  json["bus"] = of_bus(bus);
  json["drives"] = Json::array();
  for (std::size_t i = 0; i < bench.drives().size(); ++i) {
    Json drive{{"joint", bench.joints()[i]}, {"state", bench.drives()[i]->state_name()}};
    for (const auto& [key, value] : bench.drives()[i]->counts()) drive[key] = value;
    json["drives"].push_back(std::move(drive));
  }
  return json.dump(2) + "\n";
}

}  // namespace tribotwin::hil
