// SPDX-License-Identifier: Apache-2.0
// A scenario file for the time of a test.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include "campaign/campaign.hpp"

namespace ontime::campaign {

class ScenarioFile : public testing::Test {
 protected:
  ScenarioFile()
      : path_(std::filesystem::temp_directory_path() /
              ("ontime-scenario-" + std::to_string(getpid()) + ".yaml")) {
    unsetenv("ROS_DOMAIN_ID");  // the shell's own; NOLINT(concurrency-mt-unsafe): one thread
  }
  ~ScenarioFile() override { std::filesystem::remove(path_); }

  Scenario read(const std::string& text, const Selection& selection = {}) {
    std::ofstream(path_) << text;
    return read_scenario(path_, selection);
  }
  // The message, without the file's name.
  std::string error(const std::string& text, const Selection& selection = {}) {
    try {
      read(text, selection);
    } catch (const scenario::Error& error) {
      const std::string message = error.what();
      EXPECT_THAT(message, testing::HasSubstr(path_.string()));
      return message.substr(message.find(path_.string()) + path_.string().size());
    }
    return "no error";
  }
  const std::filesystem::path path_;
};

}  // namespace ontime::campaign
