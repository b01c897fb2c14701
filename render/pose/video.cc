#include <tribotwin/render/pose/video.hpp>

#include <cmath>

#include <fmt/format.h>

#include <tribotwin/render/process/child.hpp>

namespace tribotwin::render {

tl::expected<void, std::string> write_video(const std::filesystem::path& file, std::shared_ptr<const mujoco::Model> model, const twin::Recording& record,
                                            const PoseOptions& pose, const VideoOptions& options, const std::function<void(double)>& progress) {
  namespace fs = std::filesystem;
  const double wanted = options.length_s * options.frames_per_s;
  if (options.frames_per_s < 1 || options.frames_per_s > 240) return tl::unexpected(fmt::format("{} frames per second: must be 1 to 240", options.frames_per_s));
  if (!(wanted >= 1 && wanted <= 1e6)) return tl::unexpected(fmt::format("a film of {} s at {} frames per second: must have 1 to 1000000 frames", options.length_s, options.frames_per_s));
  const auto span = record.time_s.empty() ? std::span<const double>() : std::span<const double>(record.time_s);
  if (span.empty()) return tl::unexpected(std::string("the record has no samples"));
  auto painter = PosePainter::create(model, options.size, options.quality);
  if (!painter) return tl::unexpected(painter.error());
  const fs::path partial = file.string() + ".partial";
  const std::string side = fmt::format("{}x{}", options.size.width, options.size.height);
  auto ffmpeg = Child::start({{"ffmpeg", "-loglevel", "error", "-nostdin", "-f", "rawvideo", "-pixel_format", "rgb24", "-video_size", side, "-framerate",
                               fmt::to_string(options.frames_per_s), "-i", "pipe:0", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-c:v", "libx264", "-pix_fmt", "yuv420p",
                               "-crf", "20", "-movflags", "+faststart", "-f", "mp4", "-y", fs::absolute(partial).string()},
                              "ffmpeg"});
  if (!ffmpeg) return tl::unexpected(ffmpeg.error());
  std::error_code ignored;
  const auto fail = [&](const std::string& why) {
    fs::remove(partial, ignored);
    return tl::unexpected(fmt::format("{}: {}", file.string(), why));
  };
  const auto frames = static_cast<long>(std::llround(wanted));
  std::size_t index = 0;
  for (long i = 0; i < frames; ++i) {
    const double t = span.front() + (span.back() - span.front()) * (frames > 1 ? static_cast<double>(i) / static_cast<double>(frames - 1) : 1.0);
    while (index + 1 < span.size() && span[index + 1] <= t) ++index;
    const auto image = painter->draw(recorded(*model, record, index), pose);
    if (!image) return fail(image.error());
    if (auto fed = ffmpeg->write({reinterpret_cast<const char*>(image->rgb.data()), image->rgb.size()}); !fed) return fail(fed.error());
    if (progress) progress(static_cast<double>(i + 1) / static_cast<double>(frames));
  }
  if (auto ended = ffmpeg->finish(); !ended) return fail(ended.error());
  fs::rename(partial, file, ignored);
  if (ignored) return fail(ignored.message());
  return {};
}

}  // namespace tribotwin::render
