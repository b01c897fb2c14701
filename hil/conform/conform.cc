#include <algorithm>
#include <string_view>
#include <utility>

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/conform/report.hpp>

namespace tribotwin::hil {
namespace {

/// One run over the checks.
class Run {
 public:
  Run(Transport& bus, std::uint8_t node, const ConformOptions& options, ClientOptions client,
      const ConformProgress& progress)
      : client_(bus, node, std::move(client)), device_(client_, options), progress_(progress) {
    report_.node = node;
    report_.bus = bus.name();
  }

  Result<ConformReport> make(std::span<const Check> checks) {
    try {
      if (auto ok = meet(); !ok) return tl::unexpected(ok.error());
      for (std::size_t i = 0; i < checks.size(); ++i) {
        if (progress_) progress_(i, checks.size(), checks[i]);
        report_.findings.push_back(finding(checks[i]));
        clean_up();
      }
    } catch (const Interrupted&) {
      report_.interrupted = true;
    }
    leave();
    return std::move(report_);
  }

 private:
  /// The node answers, and nobody else drives it.
  Result<void> meet() {
    client_.listen(300 * ms_ns);
    const auto states = client_.heard(cob::heartbeat + device_.node());
    if (!states.empty() && states.back().frame.size == 1) found_in_ = states.back().frame.data[0] & 0x7F;
    auto type = client_.upload(od::device_type, 0);
    if (!type && found_in_ == static_cast<std::uint8_t>(Nmt::stopped)) {
      device_.pre_operational();
      type = client_.upload(od::device_type, 0);
    }
    // Served over TCP, the bus begins empty: the node's gateway has to connect first.
    for (int again = 0; again < 6 && !type && type.error().kind == SdoFailure::Kind::no_answer; ++again)
      type = client_.upload(od::device_type, 0);
    if (!type || type->size() != 4)
      return work_failed(fmt::format("node {} does not answer on {}: 1000h: {}; check --node, the bus and its bit rate",
                                     device_.node(), report_.bus,
                                     type ? fmt::format("{} bytes", type->size()) : type.error().text()));
    report_.device_type = static_cast<std::uint32_t>(decode(Type::u32, *type));
    if (const auto name = client_.upload(od::device_name, 0))
      report_.device_name.assign(name->begin(), std::ranges::find(*name, 0));
    const auto word = client_.upload(od::statusword, 0);
    const auto state =
        word && word->size() == 2 ? state_of(static_cast<std::uint16_t>(decode(Type::u16, *word))) : std::nullopt;
    drive_ = word.has_value();
    if (state == DriveState::operation_enabled || state == DriveState::quick_stop_active)
      return work_failed(fmt::format("node {} is enabled ({}): another master drives it; disable it first",
                                     device_.node(), name_of(*state)));
    owned_ = true;
    clean_up();
    return {};
  }

  /// By one of the two, so that a drive without the other is found.
  bool is_drive() const { return drive_ || (report_.device_type & 0xFFFF) == 402; }

  Finding finding(const Check& check) {
    Finding f{.check = check, .verdict = Verdict::pass, .expected = check.expected, .seen = {}};
    const auto& options = device_.options;
    if (dead_) return f.verdict = Verdict::not_run, f.seen = "the node does not answer any more", f;
    if (check.needs != Needs::nothing && !options.motion)
      return f.verdict = Verdict::not_run, f.seen = "moves or enables the drive: give --motion", f;
    if (check.needs == Needs::homing && !options.homing)
      return f.verdict = Verdict::not_run, f.seen = "changes the reference position: give --homing", f;
    if (!is_drive() && std::string_view(check.clause).find("CiA 402") != std::string_view::npos)
      return f.verdict = Verdict::not_applicable, f.seen = "no drive: 1000h names another profile, no 6041h", f;
    client_.forget();
    try {
      f.seen = check.run(device_);
    } catch (const Mismatch& m) {
      f.verdict = Verdict::fail;
      f.expected = m.expected;
      f.seen = m.seen;
    } catch (const NotApplicable& n) {
      f.verdict = Verdict::not_applicable;
      f.seen = n.reason;
    }
    return f;
  }

  /// Between checks: no power, no fault, old values, pre-operational. The cycle goes on as long as there is power.
  void clean_up() {
    // Power goes before the connection does: leaving operational enabled would be an error of the master.
    constexpr std::uint8_t disable_voltage[] = {0, 0};
    if (drive_ && !dead_) client_.download(od::controlword, 0, disable_voltage);
    client_.nmt(NmtCommand::enter_pre_operational);
    client_.listen(20 * ms_ns);
    const bool off = !drive_ || dead_ || device_.make_safe();
    client_.cycle(0);
    const auto lost = device_.restore();
    if (!lost.empty()) note(fmt::format("not restored: {}", fmt::join(lost, ", ")));
    if (dead_ || (off && client_.upload(od::device_type, 0))) return;
    // The one thing left that brings any node back.
    try {
      device_.reset(NmtCommand::reset_node);
      dead_ = !client_.upload(od::device_type, 0) || (drive_ && !device_.make_safe());
    } catch (const Mismatch&) {
      dead_ = true;
    }
    report_.without_power = !dead_;
    note(dead_ ? "the node does not answer any more, or stays enabled"
               : fmt::format("reset of the node needed after {}",
                             report_.findings.empty() ? "the start" : report_.findings.back().check.id));
  }

  void leave() {
    if (!owned_) return;
    client_.finish_undisturbed();
    clean_up();
    if (found_in_ == static_cast<std::uint8_t>(Nmt::operational)) client_.nmt(NmtCommand::start);
    if (found_in_ == static_cast<std::uint8_t>(Nmt::stopped)) client_.nmt(NmtCommand::stop);
  }

  void note(std::string text) { report_.notes.push_back(std::move(text)); }

  Client client_;
  Device device_;
  const ConformProgress& progress_;
  ConformReport report_{};
  std::uint8_t found_in_ = 0x7F;
  bool owned_ = false, drive_ = false, dead_ = false;
};

}  // namespace

Result<ConformReport> conform(Transport& bus, std::uint8_t node, const ConformOptions& options, ClientOptions client,
                              const ConformProgress& progress) {
  const auto checks = checks_named(options.only);
  if (!checks) return tl::unexpected(checks.error());
  return Run(bus, node, options, std::move(client), progress).make(*checks);
}

std::vector<Check> all_checks() {
  std::vector<Check> all;
  for (const auto part :
       {network_checks(), object_checks(), eds_checks(), sdo_checks(), service_checks(), pdo_parameter_checks(),
        pdo_checks(), emergency_checks(), state_checks(), mode_checks(), reaction_checks(), motion_checks()})
    all.insert(all.end(), part.begin(), part.end());
  return all;
}

Result<std::vector<Check>> checks_named(std::span<const std::string> names) {
  const auto is = [](const Check& check, const std::string& name) {
    const std::string_view id = check.id;
    return id == name || id.substr(0, id.find('.')) == name;
  };
  std::vector<Check> chosen = all_checks();
  for (const std::string& name : names)
    if (std::ranges::none_of(chosen, [&](const Check& check) { return is(check, name); }))
      return tl::unexpected(Error(
          fmt::format("no check is called '{}'; give ids of hil/conform/README.md, as sdo.block_upload, or groups, "
                      "as sdo, with commas between them",
                      name)));
  if (!names.empty())
    std::erase_if(chosen, [&](const Check& check) {
      return std::ranges::none_of(names, [&](const std::string& name) { return is(check, name); });
    });
  return chosen;
}

}  // namespace tribotwin::hil
