# SPDX-License-Identifier: Apache-2.0
# Dependencies of the build, with their Debian packages. All missing ones are reported at once, with the command
# that installs them: rosdep does not know all of them.
set(missing "")
macro(ontime_need package found)
  if(NOT ${found})
    list(APPEND missing ${package})
  endif()
endmacro()

foreach(need IN ITEMS "PkgConfig pkg-config" "fmt libfmt-dev" "nlohmann_json nlohmann-json3-dev" "yaml-cpp libyaml-cpp-dev"
        "SQLite3 libsqlite3-dev" "LibArchive libarchive-dev" "ZLIB zlib1g-dev" "Boost libboost-dev CONFIG" "CLI11 libcli11-dev")
  separate_arguments(need)
  list(POP_FRONT need name package config)
  find_package(${name} QUIET ${config})
  ontime_need(${package} ${name}_FOUND)
endforeach()
foreach(need IN ITEMS "BPF libbpf libbpf-dev" "CAPSTONE capstone libcapstone-dev" "CRYPTO libcrypto libssl-dev" "ELF libelf libelf-dev"
        "MICROHTTPD libmicrohttpd libmicrohttpd-dev" "MNL libmnl libmnl-dev" "PCAP libpcap libpcap-dev"
        "SODIUM libsodium libsodium-dev" "TRACEEVENT libtraceevent libtraceevent-dev")
  separate_arguments(need)
  list(POP_FRONT need name module package)
  pkg_check_modules(${name} QUIET IMPORTED_TARGET ${module})
  ontime_need(${package} ${name}_FOUND)
endforeach()
find_program(CLANG NAMES clang clang-14)
ontime_need(clang CLANG)
find_program(BPFTOOL bpftool PATHS /usr/sbin)
ontime_need(bpftool BPFTOOL)
find_file(D3 d3.min.js PATHS /usr/share/nodejs/d3/dist NO_DEFAULT_PATH NO_CMAKE_FIND_ROOT_PATH)
ontime_need(node-d3 D3)
if(missing)
  list(SORT missing)
  list(JOIN missing " " missing)
  message(FATAL_ERROR "Packages to build ontime are missing. Install them, then configure again:\n  sudo apt install ${missing}\n")
endif()
