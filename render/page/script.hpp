#pragma once

#include <span>
#include <string>

#include <tribotwin/twin/live/page.hpp>

namespace tribotwin::render {

/// What the build embeds: report.js, what_if.js, robot_figure.js.
std::span<const twin::live::PageFile> script_files();

/// The script of a page, in one piece: these and the files of the live page that it uses; those of a robot in 3-D only
/// where the page has one.
std::string script(bool robot);

}  // namespace tribotwin::render
