# Targets that users know from before their folders moved, in the tree and installed alike.
foreach(names output=io table=io telemetry=io_telemetry model=robot motion=robot search=numerics servo=control
  compensation=control
    scenario=simulation runtime=simulation laboratory=experiments_friction study=experiments_fault_study
      repeatability=experiments_working_days)
  string(REGEX MATCH "^(.*)=(.*)$" names ${names})
  set(target tribotwin::twin_${CMAKE_MATCH_2})
  get_target_property(aliased ${target} ALIASED_TARGET)   # an alias of an alias is not allowed
  if(aliased)
    set(target ${aliased})
  endif()
  if(NOT TARGET tribotwin::twin_${CMAKE_MATCH_1})
    add_library(tribotwin::twin_${CMAKE_MATCH_1} ALIAS ${target})
  endif()
endforeach()
