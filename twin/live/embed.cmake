# Writes the function NAME() of HEADER, page_files() of page.hpp say, which returns the files' contents:
# cmake -DOUT=FILE.cc "-DFILES=A;B" -DHEADER=PATH -DSPACE=NAMESPACE -DNAME=FUNCTION -P embed.cmake
set(types "html=text/html\; charset=utf-8" "js=text/javascript\; charset=utf-8" "css=text/css\; charset=utf-8"
  "svg=image/svg+xml" "json=application/json" "txt=text/plain\; charset=utf-8" "png=image/png" "wasm=application/wasm")
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
set(files "const tribotwin::twin::live::PageFile files[] = {\n${rows}};\n")
set(result files)
if(count EQUAL 0)
  set(files "")
  set(result {})
endif()
file(WRITE ${OUT} "#include <${HEADER}>\n\nnamespace ${SPACE} {\nnamespace {\n${arrays}"
  "${files}}  // namespace\n\n"
  "std::span<const tribotwin::twin::live::PageFile> ${NAME}() { return ${result}; }\n\n}  // namespace ${SPACE}\n")
