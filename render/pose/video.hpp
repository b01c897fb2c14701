#pragma once

#include <filesystem>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/render/pose/pose.hpp>
#include <tribotwin/twin/io/file.hpp>

namespace tribotwin::render {

struct VideoOptions {
  Size size{960, 720};
  Quality quality = film_quality;
  int frames_per_s = 25;  ///< 1..240
  double length_s = 20;   ///< of the film, independent of the run's duration
};

/// A run as a film (H.264 in MP4), frames piped to `ffmpeg`. The file is there whole or not at all.
Result<void> write_video(const std::filesystem::path& file, twin::Existing existing,
                         std::shared_ptr<const mujoco::Model> model, const twin::Recording& record,
                         const PoseOptions& pose, const VideoOptions& options,
                         const std::function<void(double)>& progress = {});

}  // namespace tribotwin::render
