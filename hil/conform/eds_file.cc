#include <tribotwin/hil/canopen/setup/eds_reader.hpp>
#include <tribotwin/hil/conform/eds_file.hpp>

namespace tribotwin::hil {
namespace {

/// A number of [DeviceInfo].
Result<std::optional<std::int64_t>> device_number(const EdsFile& sheet, const char* key, const char* name) {
  const auto found = sheet.device_info.find(key);
  if (found == sheet.device_info.end()) return std::nullopt;
  return sheet.number(found->second, Type::u32, 0, name);
}

}  // namespace

Result<Eds> load_eds(const std::filesystem::path& file, std::uint8_t node) {
  const auto sheet = read_eds_file(file);
  if (!sheet) return tl::unexpected(sheet.error());
  const auto vendor = device_number(*sheet, "vendornumber", "VendorNumber");
  const auto product = device_number(*sheet, "productnumber", "ProductNumber");
  if (!vendor) return tl::unexpected(vendor.error());
  if (!product) return tl::unexpected(product.error());
  auto objects = sheet->defaults();
  if (!objects) return tl::unexpected(objects.error());
  Eds eds{.objects = {}, .vendor = *vendor, .product = *product};
  for (std::size_t i = 0; i < objects->size(); ++i) {
    Object& o = (*objects)[i];
    if (o.plus_node) o.value += node;
    const bool has_default = is_number(o.type) && sheet->objects[i].default_value;
    eds.objects.push_back({std::move(o), has_default});
  }
  return eds;
}

}  // namespace tribotwin::hil
