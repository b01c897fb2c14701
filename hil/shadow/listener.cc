#include <algorithm>
#include <vector>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/nmt.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/drive_objects.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/shadow/listener.hpp>
#include <tribotwin/hil/shadow/signal.hpp>

namespace tribotwin::hil {
namespace {

constexpr std::uint8_t last_synchronous = 240;  // transmission type (CiA 301, 7.5.2.37)

bool is_tpdo_object(std::uint16_t index) { return index >= od::tpdo_communication && index < od::after_pdos; }

/// A TPDO that exists, with those of its objects that a shadow reads.
struct Tpdo {
  std::uint32_t id = 0;
  bool extended = false;
  std::uint8_t type = 255;
  std::optional<Signal> position, torque, statusword;
};

class CanopenListener final : public Listener {
 public:
  explicit CanopenListener(CanopenDrive drive) : drive_(std::move(drive)), now_(drive_.tpdo_objects) { load(); }

  Heard hear(const Frame& frame) override {
    if (frame.remote || frame.error) return {};
    if (!frame.extended) follow(frame);
    for (const Tpdo& pdo : tpdos_)
      if (pdo.id == frame.id && pdo.extended == frame.extended) return read(pdo, frame);
    return {};
  }

 private:
  using Objects = decltype(CanopenDrive::tpdo_objects);

  Heard read(const Tpdo& pdo, const Frame& frame) const {
    Heard heard;
    const bool cyclic = pdo.type >= 1 && pdo.type <= last_synchronous;
    heard.sending = cyclic ? Sending::with_sync : Sending::on_change;
    heard.every = cyclic ? pdo.type : 1;
    if (pdo.position) heard.position_rad = pdo.position->value(frame);
    if (pdo.torque) heard.torque_nm = pdo.torque->value(frame);
    heard.mean_torque = drive_.mean_torque;
    if (pdo.statusword)
      if (const auto word = pdo.statusword->raw(frame))
        heard.enabled = is_operation_enabled(static_cast<std::uint16_t>(*word));
    return heard;
  }

  void follow(const Frame& frame) {
    const auto node = static_cast<std::uint32_t>(drive_.node);
    const auto& b = frame.data;
    if (frame.id == cob::nmt) {
      const auto command = nmt_command(frame, static_cast<std::uint8_t>(node));
      if (command == NmtCommand::reset_node || command == NmtCommand::reset_communication) {
        now_ = drive_.tpdo_objects;
        load();
      }
    }
    if (frame.size != 8) return;
    const std::pair key{static_cast<std::uint16_t>(b[1] | b[2] << 8), b[3]};
    if (frame.id == cob::sdo_to_server + node && (b[0] & 0xE2) == 0x22 && is_tpdo_object(key.first)) {  // expedited
      refused_ = {key, now_[key]};
      const std::size_t size = b[0] & 1 ? 4U - (b[0] >> 2 & 3U) : 4U;
      std::int64_t value = 0;
      for (std::size_t i = size; i-- > 0;) value = value << 8 | b[4 + i];
      now_[key] = value;
      load();
    }
    if (frame.id == cob::sdo_to_client + node && b[0] == 0x80 && refused_ && refused_->first == key) {
      now_[key] = refused_->second;
      refused_.reset();
      load();
    }
  }

  std::int64_t get(int index, int sub) const {
    const auto found = now_.find({static_cast<std::uint16_t>(index), static_cast<std::uint8_t>(sub)});
    return found == now_.end() ? 0 : found->second;
  }

  void load() {
    tpdos_.clear();
    for (const auto& [key, id] : now_) {
      const auto& [index, sub] = key;
      if (index >= od::tpdo_mapping || sub != 1 || id & cob::off) continue;
      Tpdo pdo{.id = static_cast<std::uint32_t>(id) & (id & cob::extended ? cob::id_29_bit : cob::id_11_bit),
               .extended = (id & cob::extended) != 0,
               .type = static_cast<std::uint8_t>(get(index, 2))};
      map(pdo, od::mapping_of(index));
      if (pdo.position || pdo.torque || pdo.statusword) tpdos_.push_back(pdo);
    }
  }

  void map(Tpdo& pdo, int mapping) const {
    int bit = 0;
    for (int k = 1; k <= std::min<std::int64_t>(64, get(mapping, 0)); ++k) {
      const auto entry = MappingEntry::of(get(mapping, k));
      Signal signal{.start = bit, .bits = entry.bits, .kind = Signal::Kind::is_signed};
      bit += entry.bits;
      if (entry.sub != 0 || entry.bits < 1 || entry.bits > 32) continue;
      if (entry.index == od::position_actual_value) signal.factor = drive_.position_rad, pdo.position = signal;
      if (entry.index == od::torque_actual_value) signal.factor = drive_.torque_nm, pdo.torque = signal;
      if (entry.index == od::statusword) pdo.statusword = signal;
    }
  }

  CanopenDrive drive_;
  Objects now_;
  std::optional<std::pair<Objects::key_type, std::int64_t>> refused_;  // the last write and the value before it
  std::vector<Tpdo> tpdos_;
};

class MirrorListener final : public Listener {
 public:
  explicit MirrorListener(const DriveParameters& p)
      : id_(mirror_status_id(p.node)), torque_max_nm_(p.rated_torque_nm * p.gear_ratio) {}
  Heard hear(const Frame& frame) override {
    if (frame.id != id_) return {};
    const auto status = decode_status(frame);
    if (!status) return {};
    const MirrorMode state = status->state;
    return {.position_rad = status->position_rad,
            .torque_nm = status->torque_norm * torque_max_nm_,
            .mean_torque = true,
            .enabled = state == MirrorMode::torque || state == MirrorMode::position || state == MirrorMode::velocity,
            .sending = Sending::with_sync};
  }

 private:
  std::uint32_t id_;
  double torque_max_nm_;
};

}  // namespace

CanopenDrive simulated_drive(const DriveParameters& p) {
  const Dictionary dictionary = drive_dictionary(p);
  CanopenDrive drive{.node = p.node, .mean_torque = true};
  for (const Object& o : dictionary.objects())
    if (is_tpdo_object(o.index)) drive.tpdo_objects[{o.index, o.sub}] = o.value;
  drive.position_rad = dictionary.find(od::position_actual_value, 0)->scale / p.gear_ratio;
  drive.torque_nm = dictionary.find(od::torque_actual_value, 0)->scale * p.gear_ratio;
  return drive;
}

std::unique_ptr<Listener> canopen_listener(CanopenDrive drive) {
  return std::make_unique<CanopenListener>(std::move(drive));
}
std::unique_ptr<Listener> mirror_listener(const DriveParameters& parameters) {
  return std::make_unique<MirrorListener>(parameters);
}

}  // namespace tribotwin::hil
