#pragma once

#include <span>
#include <string>

#include <tribotwin/twin/live/page.hpp>

namespace tribotwin::render {

/// What the build embeds: report.js.
std::span<const twin::live::PageFile> script_files();

/// The script of a page, in one piece: report.js and the files of the live page that it uses.
std::string script();

}  // namespace tribotwin::render
