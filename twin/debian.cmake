# Debian packages by `cpack --preset debian` after a build: tribotwin (programs, models, scenarios), libtribotwin-dev
# (headers, libraries, CMake files) and, where MPI was found, tribotwin-mpi, with Debian's engine; tribotwin-plugin with
# -DTRIBOTWIN_PLUGIN_ONLY=ON and an engine of 3.2 or newer. Programs that link an engine that Debian lacks make no
# package.
set(TRIBOTWIN_MAINTAINER "tribotwin developers <packages@tribotwin.invalid>" CACHE STRING
  "Maintainer in Debian packages: NAME <ADDRESS> of whoever builds them")
if(TRIBOTWIN_PLUGIN_ONLY)
  set(CPACK_COMPONENTS_ALL plugin)
elseif(TRIBOTWIN_MUJOCO_VERSION GREATER_EQUAL 320)
  return()
else()
  set(CPACK_COMPONENTS_ALL programs dev)
  if(TARGET tribotwin_mpi)
    list(APPEND CPACK_COMPONENTS_ALL mpi)
  endif()
endif()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_CONTACT "${TRIBOTWIN_MAINTAINER}")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE
  WORLD_READ WORLD_EXECUTE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)

set(CPACK_DEBIAN_PROGRAMS_PACKAGE_NAME tribotwin)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_DEPENDS
  "gnuplot-nox | gnuplot-qt | gnuplot-x11, fonts-dejavu-core, libosmesa6")   # the last is loaded by name
set(CPACK_DEBIAN_PROGRAMS_PACKAGE_SUGGESTS "ffmpeg, chromium, libtribotwin-dev, tribotwin-mpi")
set(CPACK_COMPONENT_PROGRAMS_DESCRIPTION "Simulates robots on MuJoCo whose gears have friction that depends on speed,
load and temperature and warms them; identifies its parameters from
measurements; checks joints for faults; puts the drives on a CAN bus
(CANopen, CiA 402); writes reports. Programs: tribotwin, tribotwin-hil and
tribotwin-report, with the models and scenarios that ship.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libtribotwin-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEV_PACKAGE_SHLIBDEPS OFF)   # static libraries: their packages' headers and libraries
string(JOIN ", " CPACK_DEBIAN_DEV_PACKAGE_DEPENDS libmujoco-dev libqhull-dev libgl-dev libopengl-dev libeigen3-dev
  libpugixml-dev libyaml-cpp-dev libfmt-dev nlohmann-json3-dev libhdf5-dev libzip-dev libmatio-dev liblz4-dev
  libzstd-dev libsqlite3-dev libexpected-dev libceres-dev libboost-dev)
if(TRIBOTWIN_PQXX_FOUND)
  string(APPEND CPACK_DEBIAN_DEV_PACKAGE_DEPENDS ", libpqxx-dev")
endif()
set(CPACK_COMPONENT_DEV_DESCRIPTION "Headers, static libraries and CMake files: friction laws, heat, gears and
drives, the twin that is stepped in a loop of your own, identification.")

set(CPACK_DEBIAN_MPI_PACKAGE_NAME tribotwin-mpi)
set(CPACK_DEBIAN_MPI_PACKAGE_SECTION science)
set(CPACK_DEBIAN_MPI_PACKAGE_DEPENDS "tribotwin (= ${PROJECT_VERSION}-1), openmpi-bin")
set(CPACK_COMPONENT_MPI_DESCRIPTION "The part of tribotwin that talks MPI: with it mpirun and srun spread
independent simulations over the cores of several machines. Loaded at run
time; without it tribotwin works on one machine.")

set(CPACK_DEBIAN_PLUGIN_PACKAGE_NAME tribotwin-plugin)
set(CPACK_DEBIAN_PLUGIN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PLUGIN_PACKAGE_SHLIBDEPS OFF)   # the engine is that of the program which loads it
set(CPACK_DEBIAN_PLUGIN_PACKAGE_DEPENDS "libc6, libstdc++6 (>= 12), libgcc-s1")
set(CPACK_COMPONENT_PLUGIN_DESCRIPTION "The plugin tribotwin.drive: a motor with a gear whose friction depends on
speed, load and temperature, for any program that loads plugins of MuJoCo
${TRIBOTWIN_MUJOCO_NAME}. Debian's own MuJoCo is older and cannot load it.")

# What Debian's policy asks of every package.
string(TIMESTAMP now "%a, %d %b %Y %H:%M:%S +0000" UTC)
foreach(component ${CPACK_COMPONENTS_ALL})
  string(TOUPPER ${component} upper)
  set(package ${CPACK_DEBIAN_${upper}_PACKAGE_NAME})
  set(folder ${PROJECT_BINARY_DIR}/debian/${package})
  file(CONFIGURE OUTPUT ${folder}/changelog.Debian CONTENT
"${package} (${PROJECT_VERSION}-1) unstable; urgency=medium

  * Built from the sources by cpack.

 -- ${TRIBOTWIN_MAINTAINER}  ${now}
")
  execute_process(COMMAND gzip -9nf ${folder}/changelog.Debian COMMAND_ERROR_IS_FATAL ANY)
  file(CONFIGURE OUTPUT ${folder}/copyright CONTENT
"Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: tribotwin

Files: *
Copyright: 2026 the developers of tribotwin
License: Apache-2.0
 On Debian systems the text of the Apache License, version 2.0, is in
 /usr/share/common-licenses/Apache-2.0.
")
  install(FILES ${folder}/changelog.Debian.gz ${folder}/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package}
    COMPONENT ${component})
endforeach()
include(CPack)
