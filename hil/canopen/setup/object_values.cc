#include <algorithm>
#include <map>

#include <fmt/format.h>

#include <tribotwin/hil/canopen/cob_id.hpp>
#include <tribotwin/hil/canopen/communication_objects.hpp>
#include <tribotwin/hil/canopen/object_index.hpp>
#include <tribotwin/hil/canopen/setup/object_values.hpp>

namespace tribotwin::hil {
namespace {

/// The communication parameter of the PDO that an object belongs to; 0: of none.
od::Index pdo_of(const Dictionary& dictionary, od::Index index) {
  for (const bool transmit : {false, true})
    for (int i = 0; i < pdo_count; ++i)
      if (const od::Index at = pdo_index(transmit, i); index == at || index == od::mapping_of(at))
        return dictionary.has_index(at) ? at : od::Index{0};
  return 0;
}

class Download {
 public:
  explicit Download(Dictionary& dictionary) : dictionary_(dictionary) {}

  std::optional<RefusedValue> run(std::vector<ObjectValue> values) {
    std::map<od::Index, std::vector<ObjectValue>> pdos;
    std::vector<ObjectValue> others;
    for (ObjectValue& v : values) {
      const od::Index pdo = pdo_of(dictionary_, v.index);
      (pdo ? pdos[pdo] : others).push_back(std::move(v));
    }
    write_others(others);
    for (auto& [pdo, parameters] : pdos) write_pdo(pdo, parameters);
    return refused_;
  }

 private:
  void write(const ObjectValue& value) {
    if (refused_) return;
    if (const auto ok = dictionary_.write(value.index, value.sub, value.bytes); !ok)
      refused_ = RefusedValue{value, ok.error()};
  }
  /// A step on the way to the values.
  void write(od::Index index, std::uint8_t sub, std::int64_t value, int line) {
    const Object* o = dictionary_.find(index, sub);
    ObjectValue step{index, sub, std::vector<std::uint8_t>(o ? static_cast<std::size_t>(size_of(o->type)) : 0), line};
    encode(value, step.bytes);
    write(step);
  }

  void write_others(const std::vector<ObjectValue>& values) {
    const auto counter = std::ranges::find(values, od::synchronous_counter_overflow, &ObjectValue::index);
    const Object* cycle = dictionary_.find(od::communication_cycle_period, 0);
    const std::int64_t period = cycle ? cycle->value : 0;
    const bool stops_sync = counter != values.end() && cycle;
    if (stops_sync) write(od::communication_cycle_period, 0, 0, counter->line), write(*counter);
    if (stops_sync) write(od::communication_cycle_period, 0, period, counter->line);
    for (const ObjectValue& v : values) {
      if (v.index == od::synchronous_counter_overflow) continue;
      if (const Object* time = dictionary_.find(od::cob_id_time, 0); time && v.index == od::cob_id_time)
        write(v.index, 0, time->value & ~std::int64_t{cob::consumes}, v.line);
      write(v);
    }
  }

  void write_pdo(od::Index pdo, std::vector<ObjectValue>& values) {
    const od::Index map = od::mapping_of(pdo);
    const int line = values.front().line;
    const auto take = [&](od::Index index, std::uint8_t sub) {
      std::optional<ObjectValue> found;
      const auto at = std::ranges::find_if(values, [&](const auto& v) { return v.index == index && v.sub == sub; });
      if (at != values.end()) found = *at, values.erase(at);
      return found;
    };
    const auto identifier = take(pdo, 1), count = take(map, 0);
    const bool mapped = count || std::ranges::find(values, map, &ObjectValue::index) != values.end();
    const std::int64_t old_identifier = dictionary_.get(pdo, 1), old_count = dictionary_.get(map, 0);
    write(pdo, 1, old_identifier | cob::off, line);
    if (mapped) write(map, 0, 0, line);
    std::ranges::sort(values, {}, [](const ObjectValue& v) { return v.index << 8 | v.sub; });
    for (const ObjectValue& v : values) write(v);
    if (count)
      write(*count);
    else if (mapped)
      write(map, 0, old_count, line);
    if (identifier)
      write(*identifier);
    else
      write(pdo, 1, old_identifier, line);
  }

  Dictionary& dictionary_;
  std::optional<RefusedValue> refused_;
};

bool names_the_device(const Object& o) {
  return o.index == od::device_type || o.index == od::device_name || o.index == od::hardware_version ||
         o.index == od::software_version || (o.index == od::identity && o.sub >= 1 && o.sub <= 3);
}

}  // namespace

std::string RefusedValue::text() const {
  return fmt::format("{}: {}", object_name(value.index, value.sub), reason(why));
}

std::optional<RefusedValue> download(Dictionary& dictionary, std::vector<ObjectValue> values) {
  return Download(dictionary).run(std::move(values));
}

Dictionary with_foreign_objects(const Dictionary& own, std::span<const Object> foreign, std::uint8_t node) {
  std::vector<Object> objects(own.objects().begin(), own.objects().end());
  std::map<std::pair<od::Index, std::uint8_t>, std::size_t> places;
  for (std::size_t i = 0; i < objects.size(); ++i) places[{objects[i].index, objects[i].sub}] = i;
  const auto find = [&](od::Index index, std::uint8_t sub) {
    const auto found = places.find({index, sub});
    return found == places.end() ? nullptr : &objects[found->second];
  };
  for (Object o : foreign) {
    if (o.plus_node) o.value += node;
    Object* mine = find(o.index, o.sub);
    const bool exists = mine != nullptr;
    if (exists && names_the_device(o) && mine->type == o.type) mine->value = o.value, mine->text = o.text;
    if (exists || (own.has_index(o.index) && od::is_communication(o.index))) continue;
    if (Object* highest = find(o.index, 0); o.sub > 0 && highest) {
      if (highest->access != Access::constant && own.has_index(o.index)) continue;  // a count, or no record at all
      highest->value = std::max<std::int64_t>(highest->value, o.sub);
    }
    places[{o.index, o.sub}] = objects.size();
    objects.push_back(std::move(o));
  }
  return Dictionary(std::move(objects));
}

ObjectValue value_of(const Object& o) {
  ObjectValue value{o.index, o.sub, std::vector<std::uint8_t>(o.text.begin(), o.text.end())};
  if (!is_number(o.type)) return value;
  value.bytes.resize(static_cast<std::size_t>(size_of(o.type)));
  encode(o.value, value.bytes);
  return value;
}

}  // namespace tribotwin::hil
