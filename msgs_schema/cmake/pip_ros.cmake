# SPDX-License-Identifier: Apache-2.0
# Lets the untouched CMakeLists.txt build on the ROS wheels of the Python package index. Named as
# CMAKE_PROJECT_INCLUDE where such wheels are used; a build on an installed ROS never sees this file.

find_package(Python3 REQUIRED COMPONENTS Interpreter)

# The wheels install their share/ and lib/ below the prefix of a Python environment, for which nobody sources
# a setup file. The prefix is found from a package of the wheels, because in pip's isolated build environment
# it is not the prefix of the interpreter.
execute_process(
  COMMAND "${Python3_EXECUTABLE}" -c "
import importlib.util, pathlib
origin = pathlib.Path(importlib.util.find_spec('rosidl_pycommon').origin)
marker = 'share/ament_index/resource_index'
print(next(parent.as_posix() for parent in origin.parents if (parent / marker).is_dir()))"
  OUTPUT_VARIABLE _ros_prefix OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE _status)
if(NOT _status EQUAL 0)
  message(FATAL_ERROR "${Python3_EXECUTABLE} has no ROS generator wheels; see requires in pyproject.toml")
endif()
message(STATUS "ROS prefix ${_ros_prefix}")
set(ENV{AMENT_PREFIX_PATH} "${_ros_prefix}")
list(APPEND CMAKE_PREFIX_PATH "${_ros_prefix}")

# The wheels export the include folders of the machine they were built on, and CMake refuses imported targets
# with folders that do not exist. By the end of CMakeLists.txt all of them are known.
function(cwmav_drop_missing_include_directories)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(directories ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT directories)
      continue()
    endif()
    set(present "")
    foreach(directory IN LISTS directories)
      if(directory MATCHES "^\\$<" OR EXISTS "${directory}")
        list(APPEND present "${directory}")
      endif()
    endforeach()
    set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${present}")
  endforeach()
endfunction()
cmake_language(DEFER CALL cwmav_drop_missing_include_directories)
