#include <bit>
#include <cmath>
#include <map>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <tribotwin/hil/session/statistics.hpp>
#include <tribotwin/twin/io/json.hpp>

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

void add_counts(Json& json, const BenchCounters& c) {
  json["syncs"] = c.syncs;
  json["sync_fast"] = c.sync_fast;
}

void add_load(Json& json, const BenchCounters& c, const MeasuredBus& bus, double wall_s) {
  const auto load = [&](double bit_rate) { return wall_s > 0 ? c.bits / (bit_rate * wall_s) : 0; };
  json["frames_in"] = c.frames_in;
  json["frames_foreign"] = c.foreign;
  json["frames_out"] = c.frames_out;
  json["bus_load_1_mbit"] = load(1e6);
  if (!bus.bit_rate) return;
  json["bit_rate"] = std::llround(*bus.bit_rate);
  json["bus_load"] = load(*bus.bit_rate);
}

Json of_buses(const Bench& bench, std::span<const MeasuredBus> buses, double wall_s) {
  Json all = Json::array();
  for (std::size_t i = 0; i < buses.size(); ++i) {
    Json json{{"channel", channel_of(i)}, {"address", buses[i].address}};
    add_counts(json, bench.counters(i));
    json["sync_alone"] = bench.counters(i).sync_alone;
    add_load(json, bench.counters(i), buses[i], wall_s);
    if (buses[i].sync) add_sync(json, *buses[i].sync, bench.cycle_us());
    json["bus"] = of_bus(buses[i].counters);
    all.push_back(std::move(json));
  }
  return all;
}

}  // namespace

std::string statistics_json(const Bench& bench, std::span<const MeasuredBus> buses, double wall_s, const Pace* pace) {
  const bool one = buses.size() == 1;
  Json json{{"wall_s", wall_s}, {"simulated_s", bench.plant().twin().time_s()}};
  if (one) {
    add_counts(json, bench.counters());
    add_load(json, bench.counters(), buses[0], wall_s);
    if (buses[0].sync) add_sync(json, *buses[0].sync, bench.cycle_us());
  }
  if (pace) add_pace(json, *pace);
  if (one)
    json["bus"] = of_bus(buses[0].counters);
  else
    json["buses"] = of_buses(bench, buses, wall_s);
  json["drives"] = Json::array();
  for (std::size_t i = 0; i < bench.drives().size(); ++i) {
    Json drive{{"joint", bench.joints()[i]}, {"state", bench.drives()[i]->state_name()}};
    if (!one) drive["channel"] = channel_of(bench.bus_of(i));
    for (const auto& [key, value] : bench.drives()[i]->counts()) drive[key] = value;
    json["drives"].push_back(std::move(drive));
  }
  return twin::dump_json(json, 2) + "\n";
}

}  // namespace tribotwin::hil
