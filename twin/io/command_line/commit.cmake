# Writes FILE, a header with the commit of SOURCE, if it has changed: cmake -DSOURCE=. -DFILE=commit.hpp -P commit.cmake
# In a source tree that is not itself a git repository, such as an unpacked archive, the commit is unknown.
set(commit unknown)
set(date ${RELEASE_DATE})
find_program(GIT git)
if(GIT)
  execute_process(COMMAND ${GIT} -C ${SOURCE} rev-parse --show-toplevel OUTPUT_VARIABLE top ERROR_QUIET
    OUTPUT_STRIP_TRAILING_WHITESPACE)
  file(REAL_PATH ${SOURCE} source)
  if(top STREQUAL source)
    execute_process(COMMAND ${GIT} -C ${SOURCE} log -1 --format=%h\ %cs --abbrev=12
      OUTPUT_VARIABLE line ERROR_QUIET OUTPUT_STRIP_TRAILING_WHITESPACE)
    if(line MATCHES "^([0-9a-f]+).*([0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9])$")
      set(commit ${CMAKE_MATCH_1})
      set(date ${CMAKE_MATCH_2})
      execute_process(COMMAND ${GIT} -C ${SOURCE} diff --quiet HEAD RESULT_VARIABLE changed ERROR_QUIET)
      if(changed)
        string(APPEND commit "+changes")
      endif()
    endif()
  endif()
endif()
file(CONFIGURE OUTPUT ${FILE} CONTENT
  "#define TRIBOTWIN_COMMIT \"${commit}\"\n#define TRIBOTWIN_COMMIT_DATE \"${date}\"\n\n")
