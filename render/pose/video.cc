#include <cmath>
#include <cstdint>
#include <fstream>
#include <future>
#include <string_view>

#include <fmt/format.h>

#include <tribotwin/render/pose/moment.hpp>
#include <tribotwin/render/pose/video.hpp>
#include <tribotwin/render/process/child.hpp>

namespace tribotwin::render {
namespace {

/// How long a work cycle takes in a film that shows some of many.
constexpr double cycle_shortest_s = 1, cycle_longest_s = 4;

/// Whether the file is a complete MP4: ffmpeg may end with exit code 0 on a full disk.
Result<void> check_film(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  const std::uint64_t size = std::filesystem::file_size(file);
  std::uint64_t at = 0;
  bool index = false;
  while (at < size) {
    unsigned char head[16]{};
    in.seekg(static_cast<std::streamoff>(at));
    in.read(reinterpret_cast<char*>(head), sizeof head);
    const auto number = [&](int from, int count) {
      std::uint64_t n = 0;
      for (int i = 0; i < count; ++i) n = n << 8 | head[from + i];
      return n;
    };
    const std::uint64_t length = number(0, 4) == 1 ? number(8, 8) : number(0, 4);
    if (length < 8 || length > size - at) break;
    index |= std::string_view(reinterpret_cast<char*>(head) + 4, 4) == "moov";
    at += length;
  }
  if (at == size && index) return {};
  return work_failed("ffmpeg wrote an incomplete film; is the disk full?");
}

Result<void> taken(std::future<Result<void>>& frame) { return frame.valid() ? frame.get() : Result<void>(); }

}  // namespace

Result<void> write_video(const std::filesystem::path& file, twin::Existing existing,
                         std::shared_ptr<const mujoco::Model> model, const twin::Recording& record,
                         const PoseOptions& pose, const VideoOptions& options,
                         const std::function<void(double)>& progress) {
  const double wanted = options.length_s * options.frames_per_s;
  if (options.frames_per_s < 1 || options.frames_per_s > 240)
    return tl::unexpected(fmt::format("{} frames per second: must be 1 to 240", options.frames_per_s));
  if (!(wanted >= 1 && wanted <= 1e6))
    return tl::unexpected(fmt::format("a film of {} s at {} frames per second: must have 1 to 1000000 frames",
                                      options.length_s, options.frames_per_s));
  const auto span = record.time_s.empty() ? std::span<const double>() : std::span<const double>(record.time_s);
  if (span.empty()) return tl::unexpected(Error("the record has no samples"));
  auto painter = PosePainter::create(model, options.size, options.quality);
  if (!painter) return tl::unexpected(painter.error());
  auto film = twin::NewFile::create(file, existing);
  if (!film) return work_failed(film.error().message);
  const std::string side = fmt::format("{}x{}", options.size.width, options.size.height);
  auto ffmpeg = Child::start({{"ffmpeg",
                               "-loglevel",
                               "error",
                               "-nostdin",
                               "-f",
                               "rawvideo",
                               "-pixel_format",
                               "rgb24",
                               "-video_size",
                               side,
                               "-framerate",
                               fmt::to_string(options.frames_per_s),
                               "-i",
                               "pipe:0",
                               "-vf",
                               "pad=ceil(iw/2)*2:ceil(ih/2)*2",
                               "-c:v",
                               "libx264",
                               "-preset",
                               "veryfast",
                               "-pix_fmt",
                               "yuv420p",
                               "-crf",
                               "20",
                               "-movflags",
                               "+faststart",
                               "-f",
                               "mp4",
                               "-y",
                               "/proc/self/fd/3"},  // by its name it would make the file again that a signal removed
                              "ffmpeg",
                              film->descriptor()});
  if (!ffmpeg) return tl::unexpected(ffmpeg.error());
  const auto fail = [&](const Error& e) {
    return tl::unexpected(Error(fmt::format("{}: {}", file.string(), e.message), e.kind));
  };
  const Moments moments(*model, record);
  const auto cycle_frames = static_cast<std::size_t>(std::clamp(moments.period_s(), cycle_shortest_s, cycle_longest_s) *
                                                     options.frames_per_s);
  const auto times = moments.film_times(static_cast<std::size_t>(std::llround(wanted)), cycle_frames);
  // A frame is drawn while ffmpeg takes the one before.
  std::future<Result<void>> fed;
  for (std::size_t i = 0; i < times.size(); ++i) {
    auto image = painter->draw(moments.at(times[i]), pose);
    if (!image) return fail(image.error());
    if (auto before = taken(fed); !before) return fail(before.error());
    fed = std::async(std::launch::async, [&ffmpeg = *ffmpeg, frame = std::move(*image)] {
      return ffmpeg.write({reinterpret_cast<const char*>(frame.rgb.data()), frame.rgb.size()});
    });
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(times.size()));
  }
  if (auto last = taken(fed); !last) return fail(last.error());
  const auto said = ffmpeg->finish();
  if (!said) return fail(said.error());
  if (!said->empty()) return fail({"ffmpeg: " + *said, ErrorKind::work});
  if (auto whole = check_film(film->partial()); !whole) return fail(whole.error());
  if (auto published = film->publish(); !published) return work_failed(published.error().message);
  return {};
}

}  // namespace tribotwin::render
