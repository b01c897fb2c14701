#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/cia402/node.hpp>
#include <tribotwin/hil/mirror/mirror.hpp>
#include <tribotwin/hil/session/listener.hpp>

namespace tribotwin::hil {
namespace {

/// Feeds the master's NMT and SDO requests to a node of its own, so that it knows a mapping changed while it listened.
class CanopenListener final : public Listener {
 public:
  explicit CanopenListener(const DriveParameters& p)
      : gear_(p.gear_ratio), node_(p, [](const Frame&) { return Sent::done; }) {
    node_.start(0);
  }
  bool hear(const Frame& frame) override {
    if (frame.id == cob::nmt || frame.id == cob::sdo_to_server + node_.id()) node_.receive(frame, frame.time_ns);
    Dictionary& d = node_.dictionary();
    bool position = false;
    for (int i = 0; i < pdo_count; ++i) {
      const std::uint16_t index = pdo_index(true, i), map = od::mapping_of(index);
      const auto id = d.get(index, 1);
      if (id & cob::off || (id & cob::id_11_bit) != frame.id || frame.extended) continue;
      std::size_t at = 0;
      for (std::uint8_t k = 1; k <= d.get(map, 0); ++k) {
        const auto entry = MappingEntry::of(d.get(map, k));
        const auto size = static_cast<std::size_t>(entry.bits / 8);
        if (at + size > frame.size) break;
        if (const Object* o = d.find(entry.index, entry.sub)) {
          const auto value = static_cast<double>(decode(o->type, frame.bytes().subspan(at, size))) * o->scale;
          if (o->index == od::position_actual_value) position_rad = value / gear_, position = true;
          if (o->index == od::torque_actual_value) torque_nm = value * gear_, torque_heard = true;
        }
        at += size;
      }
    }
    return position;
  }

 private:
  double gear_;
  Node node_;
};

class MirrorListener final : public Listener {
 public:
  explicit MirrorListener(const DriveParameters& p)
      : id_(mirror_status_id(p.node)), torque_max_nm_(p.rated_torque_nm * p.gear_ratio) {}
  bool hear(const Frame& frame) override {
    if (frame.id != id_) return false;
    const auto status = decode_status(frame);
    if (!status) return false;
    position_rad = status->position_rad;
    torque_nm = status->torque_norm * torque_max_nm_;
    torque_heard = true;
    return true;
  }

 private:
  std::uint32_t id_;
  double torque_max_nm_;
};

}  // namespace

std::unique_ptr<Listener> make_listener(Profile profile, const DriveParameters& parameters) {
  if (profile == Profile::mirror) return std::make_unique<MirrorListener>(parameters);
  return std::make_unique<CanopenListener>(parameters);
}

}  // namespace tribotwin::hil
