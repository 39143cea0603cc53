// SPDX-License-Identifier: Apache-2.0
#include "counter.hpp"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <dlfcn.h>
#include <execinfo.h>
#include <link.h>

namespace ontime::allocations {
namespace {

// What a shared object is, by how its file's name begins.
constexpr std::pair<std::string_view, Layer> objects[] = {
    {"ontime_transport_ros2.so", Layer::ontime},
    {"libontime_rclcpp.so", Layer::ontime},
    {"librclcpp", Layer::rclcpp},
    {"librmw_dds_common__", Layer::type_support},
    {"librmw_dds_common.so", Layer::rmw_implementation},
    {"librmw_implementation", Layer::rcl_and_rmw},
    {"librmw.so", Layer::rcl_and_rmw},
    {"librmw_", Layer::rmw_implementation},
    {"librcl.so", Layer::rcl_and_rmw},
    {"librcutils", Layer::rcl_and_rmw},
    {"librcpputils", Layer::rcl_and_rmw},
    {"libtracetools", Layer::rcl_and_rmw},
    {"libddsc", Layer::dds},
    {"libfastrtps", Layer::dds},
    {"libfastdds", Layer::dds},
    {"libfastcdr", Layer::type_support},
    {"librosidl_", Layer::type_support},
    {"libontime_msgs__", Layer::type_support},
};

struct Object {
  std::uintptr_t begin;
  std::uintptr_t end;
  std::optional<Layer> layer;  // none: a library of the language, which asks for others
};

std::vector<Object> loaded;  // as arm() found them
std::array<std::atomic<std::uint64_t>, layer_names.size()> counts;
std::atomic<bool> armed{false};
thread_local bool counting = false;

std::optional<Layer> layer_of(const std::string& path) {
  if (path.empty()) return Layer::ontime;  // this program
  const std::string name = std::filesystem::path(path).filename();
  for (const std::string_view language : {"libc.so", "libstdc++.so", "libgcc_s.so", "ld-linux", "libpthread"})
    if (name.starts_with(language)) return {};
  for (const auto& [beginning, layer] : objects)
    if (name.starts_with(beginning)) return layer;
  return Layer::other;
}

int add_object(dl_phdr_info* info, std::size_t, void*) {
  for (int i = 0; i < info->dlpi_phnum; ++i) {
    const auto& segment = info->dlpi_phdr[i];
    if (segment.p_type != PT_LOAD || (segment.p_flags & PF_X) == 0) continue;
    const std::uintptr_t begin = info->dlpi_addr + segment.p_vaddr;
    loaded.push_back({begin, begin + segment.p_memsz, layer_of(info->dlpi_name)});
  }
  return 0;
}

// In ontime's objects there is code of templates: of rclcpp, and of the C++ library.
std::optional<Layer> layer_in_ontime(const void* address) {
  Dl_info found{};
  if (dladdr(address, &found) == 0 || found.dli_sname == nullptr) return Layer::ontime;
  const std::string_view symbol = found.dli_sname;
  const auto is_within = [&](std::string_view scope) {
    return symbol.starts_with("_ZN" + std::string(scope)) ||
           symbol.starts_with("_ZNK" + std::string(scope)) ||
           symbol.starts_with("_ZZN" + std::string(scope)) ||
           symbol.starts_with("_ZZNK" + std::string(scope));
  };
  if (is_within("6rclcpp")) return Layer::rclcpp;
  if (is_within("11ontime_msgs")) return Layer::type_support;
  if (is_within("St") || is_within("9__gnu_cxx") || symbol.starts_with("_ZSt")) return {};
  return Layer::ontime;
}

std::optional<Layer> layer_at(const void* address) {
  const auto at = reinterpret_cast<std::uintptr_t>(address);
  for (const Object& object : loaded)
    if (at >= object.begin && at < object.end)
      return object.layer == Layer::ontime ? layer_in_ontime(address) : object.layer;
  return {};
}

[[gnu::noinline]] void count() {
  if (!armed.load(std::memory_order_relaxed) || counting) return;
  counting = true;
  std::array<void*, 32> frames;
  const int depth = backtrace(frames.data(), static_cast<int>(frames.size()));
  Layer layer = Layer::other;
  for (int i = 2; i < depth; ++i)  // after ourselves and malloc
    if (const auto found = layer_at(frames[static_cast<std::size_t>(i)])) {
      layer = *found;
      break;
    }
  counts[static_cast<std::size_t>(layer)].fetch_add(1, std::memory_order_relaxed);
  counting = false;
}

}  // namespace

void arm() {
  loaded.clear();
  dl_iterate_phdr(add_object, nullptr);
  void* frame = nullptr;
  backtrace(&frame, 1);  // the first one loads the unwinder
  for (auto& of_layer : counts) of_layer = 0;
  armed = true;
}

Counts disarm() {
  armed = false;
  Counts result;
  std::copy(counts.begin(), counts.end(), result.begin());
  return result;
}

}  // namespace ontime::allocations

// The C library's own, under the names that it keeps for those who put themselves before it.
extern "C" {
void* __libc_malloc(std::size_t);
void* __libc_calloc(std::size_t, std::size_t);
void* __libc_realloc(void*, std::size_t);
void* __libc_memalign(std::size_t, std::size_t);

__attribute__((noinline)) void* malloc(std::size_t bytes) {
  ontime::allocations::count();
  return __libc_malloc(bytes);
}
__attribute__((noinline)) void* calloc(std::size_t number, std::size_t bytes) {
  ontime::allocations::count();
  return __libc_calloc(number, bytes);
}
__attribute__((noinline)) void* realloc(void* block, std::size_t bytes) {
  ontime::allocations::count();
  return __libc_realloc(block, bytes);
}
__attribute__((noinline)) void* aligned_alloc(std::size_t alignment, std::size_t bytes) {
  ontime::allocations::count();
  return __libc_memalign(alignment, bytes);
}
}
