# Writes page_files() of page.hpp: cmake -DOUT=FILE.cc "-DFILES=A;B" -P embed.cmake
set(types "html=text/html\; charset=utf-8" "js=text/javascript\; charset=utf-8" "css=text/css\; charset=utf-8"
  "svg=image/svg+xml" "json=application/json" "txt=text/plain\; charset=utf-8" "png=image/png")
set(arrays "")
set(rows "")
set(count 0)
foreach(file ${FILES})
  get_filename_component(name ${file} NAME)
  string(REGEX REPLACE "^.*\\." "" ending ${name})
  set(type "")
  foreach(row IN LISTS types)
    if(row MATCHES "^${ending}=(.*)$")
      set(type "${CMAKE_MATCH_1}")
    endif()
  endforeach()
  if(type STREQUAL "")
    message(FATAL_ERROR "${file}: embed.cmake has no content type for .${ending}")
  endif()
  file(READ ${file} bytes HEX)
  string(REGEX REPLACE "(..)" "\\\\x\\1" bytes "${bytes}")
  string(APPEND arrays "const char file_${count}[] = \"${bytes}\";\n")  # compiles far faster than a list of numbers
  string(APPEND rows "    {\"${name}\", \"${type}\", {file_${count}, sizeof file_${count} - 1}},\n")
  math(EXPR count "${count} + 1")
endforeach()
file(WRITE ${OUT} "#include <tribotwin/twin/live/page.hpp>\n\nnamespace tribotwin::twin::live {\nnamespace {\n${arrays}"
  "const PageFile files[] = {\n${rows}};\n}  // namespace\n\n"
  "std::span<const PageFile> page_files() { return files; }\n\n}  // namespace tribotwin::twin::live\n")
