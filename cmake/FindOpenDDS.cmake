# SPDX-License-Identifier: Apache-2.0
# OpenDDS, with the ACE and TAO that it was built with, where its setenv.sh says: DDS_ROOT, ACE_ROOT, TAO_ROOT.
#
# OpenDDS_VERSION, OpenDDS_FOUND; the target OpenDDS::Rtps, discovery and data as RTPS over UDP; and the function
# opendds_type(TARGET FILE.idl), which makes an object library of a type.
find_path(OpenDDS_INCLUDE_DIR dds/DCPS/Service_Participant.h HINTS ENV DDS_ROOT)
find_path(OpenDDS_ACE_INCLUDE_DIR ace/config.h HINTS ENV ACE_ROOT)
find_path(OpenDDS_TAO_INCLUDE_DIR tao/corba.h HINTS ENV TAO_ROOT)
find_program(OpenDDS_IDL opendds_idl HINTS ENV DDS_ROOT PATH_SUFFIXES bin)
find_program(OpenDDS_TAO_IDL tao_idl HINTS ENV ACE_ROOT PATH_SUFFIXES bin)
set(OpenDDS_LIBRARIES)
foreach(library OpenDDS_Rtps_Udp OpenDDS_Rtps OpenDDS_Dcps TAO_AnyTypeCode TAO ACE)
  find_library(OpenDDS_LIBRARY_${library} ${library} HINTS ENV DDS_ROOT ENV ACE_ROOT PATH_SUFFIXES lib)
  list(APPEND OpenDDS_LIBRARIES OpenDDS_LIBRARY_${library})
endforeach()

if(OpenDDS_INCLUDE_DIR)
  set(OpenDDS_VERSION)
  foreach(part MAJOR MINOR MICRO)
    file(STRINGS ${OpenDDS_INCLUDE_DIR}/dds/Version.h line REGEX "define (OPEN)?DDS_${part}_VERSION [0-9]+")
    string(REGEX MATCH "[0-9]+" number "${line}")
    list(APPEND OpenDDS_VERSION "${number}")
  endforeach()
  list(JOIN OpenDDS_VERSION . OpenDDS_VERSION)
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenDDS VERSION_VAR OpenDDS_VERSION REQUIRED_VARS
  OpenDDS_INCLUDE_DIR OpenDDS_ACE_INCLUDE_DIR OpenDDS_TAO_INCLUDE_DIR OpenDDS_IDL OpenDDS_TAO_IDL ${OpenDDS_LIBRARIES})
mark_as_advanced(OpenDDS_INCLUDE_DIR OpenDDS_ACE_INCLUDE_DIR OpenDDS_TAO_INCLUDE_DIR OpenDDS_IDL OpenDDS_TAO_IDL ${OpenDDS_LIBRARIES})

if(OpenDDS_FOUND AND NOT TARGET OpenDDS::Rtps)
  add_library(OpenDDS::Rtps INTERFACE IMPORTED)
  target_include_directories(OpenDDS::Rtps SYSTEM INTERFACE ${OpenDDS_INCLUDE_DIR} ${OpenDDS_ACE_INCLUDE_DIR} ${OpenDDS_TAO_INCLUDE_DIR})
  target_compile_definitions(OpenDDS::Rtps INTERFACE _GNU_SOURCE)
  foreach(library ${OpenDDS_LIBRARIES})
    target_link_libraries(OpenDDS::Rtps INTERFACE ${${library}})
    cmake_path(GET ${library} PARENT_PATH folder)
    list(APPEND OpenDDS_LIBRARY_DIRS ${folder})
  endforeach()
  list(REMOVE_DUPLICATES OpenDDS_LIBRARY_DIRS)
  # Its libraries do not state where their dependencies are; only an old-style RPATH (no RUNPATH) finds them.
  foreach(folder ${OpenDDS_LIBRARY_DIRS})
    target_link_options(OpenDDS::Rtps INTERFACE LINKER:-rpath-link,${folder})
  endforeach()
  target_link_options(OpenDDS::Rtps INTERFACE LINKER:--disable-new-dtags)

  list(JOIN OpenDDS_LIBRARY_DIRS : folders)
  set(OpenDDS_ENVIRONMENT ${CMAKE_COMMAND} -E env DDS_ROOT=${OpenDDS_INCLUDE_DIR} ACE_ROOT=${OpenDDS_ACE_INCLUDE_DIR}
    TAO_ROOT=${OpenDDS_TAO_INCLUDE_DIR} LD_LIBRARY_PATH=${folders})
endif()

function(opendds_type target idl)
  cmake_path(GET idl STEM name)
  set(here ${CMAKE_CURRENT_BINARY_DIR})
  set(made ${name}C.cpp ${name}TypeSupportC.cpp ${name}TypeSupportImpl.cpp)
  list(TRANSFORM made PREPEND ${here}/)
  add_custom_command(OUTPUT ${made} ${here}/${name}TypeSupportImpl.h DEPENDS ${idl} WORKING_DIRECTORY ${here}
    COMMAND ${OpenDDS_ENVIRONMENT} ${OpenDDS_TAO_IDL} -SS -o ${here} ${CMAKE_CURRENT_SOURCE_DIR}/${idl}
    COMMAND ${OpenDDS_ENVIRONMENT} ${OpenDDS_IDL} -o ${here} ${CMAKE_CURRENT_SOURCE_DIR}/${idl}
    COMMAND ${OpenDDS_ENVIRONMENT} ${OpenDDS_TAO_IDL} -SS -I${OpenDDS_INCLUDE_DIR} -I${CMAKE_CURRENT_SOURCE_DIR} ${name}TypeSupport.idl)
  add_library(${target} OBJECT ${made})
  target_include_directories(${target} SYSTEM PUBLIC ${here})
  target_compile_options(${target} PRIVATE -w)
  target_link_libraries(${target} PUBLIC OpenDDS::Rtps)
endfunction()
