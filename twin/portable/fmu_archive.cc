#include <memory>

#include <fmt/format.h>
#include <zip.h>

#include <tribotwin/twin/portable/fmu.hpp>

namespace tribotwin::twin {
namespace {

using Archive = std::unique_ptr<zip_t, void (*)(zip_t*)>;

/// Adds a file with a fixed date, 1980-01-01: the same content gives the same bytes.
bool add(zip_t* archive, const FmuFile& file) {
  zip_source_t* source = zip_source_buffer(archive, file.content.data(), file.content.size(), 0);
  if (!source) return false;
  const zip_int64_t entry = zip_file_add(archive, file.name.c_str(), source, ZIP_FL_ENC_UTF_8);
  if (entry < 0) {
    zip_source_free(source);
    return false;
  }
  return zip_file_set_dostime(archive, static_cast<zip_uint64_t>(entry), 0, 1 << 5 | 1, 0) == 0;
}

}  // namespace

Result<std::string> zipped(const std::vector<FmuFile>& files) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* memory = zip_source_buffer_create(nullptr, 0, 0, &error);
  if (!memory) return work_failed(fmt::format("the archive cannot be made: {}", zip_error_strerror(&error)));
  const std::unique_ptr<zip_source_t, void (*)(zip_source_t*)> owner(memory, zip_source_free);
  Archive archive(zip_open_from_source(memory, ZIP_CREATE | ZIP_TRUNCATE, &error), zip_discard);
  if (!archive) return work_failed(fmt::format("the archive cannot be made: {}", zip_error_strerror(&error)));
  zip_source_keep(memory);  // what the archive frees is its own share
  for (const FmuFile& file : files)
    if (!add(archive.get(), file))
      return work_failed(fmt::format("{}: cannot be archived: {}", file.name, zip_strerror(archive.get())));
  if (zip_close(archive.get()) != 0)
    return work_failed(fmt::format("the archive cannot be made: {}", zip_strerror(archive.get())));
  (void)archive.release();
  zip_stat_t stat;
  if (zip_source_stat(memory, &stat) != 0 || zip_source_open(memory) != 0)
    return work_failed("the archive cannot be read");
  std::string bytes(stat.size, '\0');
  const zip_int64_t got = zip_source_read(memory, bytes.data(), bytes.size());
  zip_source_close(memory);
  if (got < 0 || static_cast<std::size_t>(got) != bytes.size()) return work_failed("the archive cannot be read");
  return bytes;
}

}  // namespace tribotwin::twin
