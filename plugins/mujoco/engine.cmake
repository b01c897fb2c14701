# Finds MuJoCo as mujoco::mujoco. -Dmujoco_ROOT=FOLDER names one: a CMake prefix, an unpacked release (include/ and
# lib/, no CMake files) or the folder of Python's package mujoco (include/ and the library beside it). No other is taken
# then; without it CMake looks where it looks for every package.
# Sets TRIBOTWIN_MUJOCO_VERSION, the engine's mjVERSION_HEADER (222, 337, 3012000), and TRIBOTWIN_MUJOCO_NAME, the
# same as people write it (2.2.2, 3.3.7, 3.12), and TRIBOTWIN_MUJOCO_INCLUDE_DIR.
if(NOT mujoco_ROOT AND DEFINED ENV{mujoco_ROOT})
  set(mujoco_ROOT $ENV{mujoco_ROOT})
endif()

if(NOT TARGET mujoco::mujoco AND mujoco_ROOT)
  get_filename_component(mujoco_ROOT "${mujoco_ROOT}" ABSOLUTE BASE_DIR "${CMAKE_BINARY_DIR}")
  unset(mujoco_DIR CACHE)   # of an earlier call
  find_package(mujoco CONFIG QUIET PATHS ${mujoco_ROOT} NO_DEFAULT_PATH)
  if(NOT mujoco_FOUND)
    find_path(TRIBOTWIN_MUJOCO_INCLUDE mujoco/mujoco.h PATHS ${mujoco_ROOT}/include NO_DEFAULT_PATH NO_CACHE)
    file(GLOB TRIBOTWIN_MUJOCO_LIBRARY ${mujoco_ROOT}/lib/libmujoco.so ${mujoco_ROOT}/libmujoco.so.*)
    if(NOT TRIBOTWIN_MUJOCO_INCLUDE OR NOT TRIBOTWIN_MUJOCO_LIBRARY)
      message(FATAL_ERROR "mujoco_ROOT is ${mujoco_ROOT}, which holds neither lib/cmake/mujoco nor "
        "include/mujoco/mujoco.h with lib/libmujoco.so: give the folder of an unpacked MuJoCo release, of Python's "
        "package mujoco, or the prefix of an installed one")
    endif()
    add_library(mujoco::mujoco SHARED IMPORTED)
    set_target_properties(mujoco::mujoco PROPERTIES IMPORTED_LOCATION ${TRIBOTWIN_MUJOCO_LIBRARY}
      INTERFACE_INCLUDE_DIRECTORIES ${TRIBOTWIN_MUJOCO_INCLUDE})
  endif()
elseif(NOT TARGET mujoco::mujoco)
  find_package(mujoco REQUIRED)
endif()

get_target_property(_tribotwin_includes mujoco::mujoco INTERFACE_INCLUDE_DIRECTORIES)
unset(TRIBOTWIN_MUJOCO_VERSION)
foreach(_tribotwin_include ${_tribotwin_includes})
  if(NOT TRIBOTWIN_MUJOCO_VERSION AND EXISTS ${_tribotwin_include}/mujoco/mujoco.h)
    file(STRINGS ${_tribotwin_include}/mujoco/mujoco.h _tribotwin_line REGEX "define mjVERSION_HEADER")
    string(REGEX MATCH "[0-9]+" TRIBOTWIN_MUJOCO_VERSION "${_tribotwin_line}")
    set(TRIBOTWIN_MUJOCO_INCLUDE_DIR ${_tribotwin_include})
  endif()
endforeach()
if(NOT TRIBOTWIN_MUJOCO_VERSION)
  message(FATAL_ERROR "no mjVERSION_HEADER in mujoco/mujoco.h of ${_tribotwin_includes}")
elseif(TRIBOTWIN_MUJOCO_VERSION EQUAL 4000000)
  message(FATAL_ERROR "MuJoCo 4.0.0 can factor a sparse Newton Hessian wrongly; use 4.0.1 or newer")
endif()

if(TRIBOTWIN_MUJOCO_VERSION GREATER_EQUAL 1000000)
  set(_tribotwin_base 1000)
else()
  set(_tribotwin_base 10)
endif()
math(EXPR _tribotwin_major "${TRIBOTWIN_MUJOCO_VERSION} / ${_tribotwin_base} / ${_tribotwin_base}")
math(EXPR _tribotwin_minor "${TRIBOTWIN_MUJOCO_VERSION} / ${_tribotwin_base} % ${_tribotwin_base}")
math(EXPR _tribotwin_patch "${TRIBOTWIN_MUJOCO_VERSION} % ${_tribotwin_base}")
string(REGEX REPLACE "\\.0$" "" TRIBOTWIN_MUJOCO_NAME
  ${_tribotwin_major}.${_tribotwin_minor}.${_tribotwin_patch})
