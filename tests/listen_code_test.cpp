// SPDX-License-Identifier: Apache-2.0
#ifdef __x86_64__
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "listen/code.hpp"
#include "listen/event.h"

namespace ontime::listen {
namespace {

using Instructions = std::vector<std::uint8_t>;
constexpr std::uint64_t address = 0x1000;

Entry entry_at(const Instructions& bytes, std::vector<std::size_t> arguments, bool is_whole = true) {
  return entry_of({bytes, address, is_whole}, arguments);
}
Exit exit_at(const Instructions& bytes, bool is_whole = true) { return exit_of({bytes, address, is_whole}); }

// dds_take() of Cyclone DDS 0.10.2 as Debian compiles it: all that it does is to call a function of its own.
const Instructions wrapper{
    0x48, 0x83, 0xec, 0x08,        // sub $8, %rsp
    0x31, 0xc0,                    // xor %eax, %eax
    0x41, 0x83, 0xf8, 0xed,        // cmp $-19, %r8d
    0x49, 0x89, 0xd1,              // mov %rdx, %r9
    0x0f, 0x95, 0xc0,              // setne %al
    0x6a, 0x00,                    // push $0
    0x44, 0x0f, 0x44, 0xc1,        // cmove %ecx, %r8d
    0x48, 0x89, 0xf2,              // mov %rsi, %rdx
    0x50,                          // push %rax
    0x89, 0xfe,                    // mov %edi, %esi
    0xe8, 0x00, 0x01, 0x00, 0x00,  // call 0x1121
    0x48, 0x83, 0xc4, 0x18,        // add $24, %rsp
    0xc3,                          // ret
};
constexpr std::uint64_t push_at = 25, call_at = 28;

TEST(CodeOfFunction, ShiftedArgumentsAreFoundAtTheCheapPlace) {
  const auto entry = entry_at(wrapper, {0, 2});
  EXPECT_TRUE(entry.is_cheap);
  EXPECT_EQ(entry.offset, push_at);
  EXPECT_EQ(entry.registers[0], ontime_argument_1);
  EXPECT_EQ(entry.registers[2], ontime_r9);
}

TEST(CodeOfFunction, OverwrittenArgumentMovesTheProbeToTheFirstByte) {
  Instructions code = wrapper;
  code[push_at] = 0x90;                               // nop
  code[10] = 0x31, code[11] = 0xd2, code[12] = 0x90;  // xor %edx, %edx; nop
  const auto entry = entry_at(code, {0, 2});
  EXPECT_FALSE(entry.is_cheap);
  EXPECT_EQ(entry.offset, 0U);
  EXPECT_EQ(entry.registers[2], ontime_argument_3);
}

TEST(CodeOfFunction, ForwardingFunctionExitsInItsCallee) {
  EXPECT_EQ(exit_at(wrapper).callee, address + call_at + 5 + 0x100);
}

TEST(CodeOfFunction, FunctionThatChangesItsCalleesResultHasNoCallee) {
  Instructions code = wrapper;
  code[call_at + 5] = 0x48, code[call_at + 6] = 0x31, code[call_at + 7] = 0xc0;  // xor %rax, %rax
  code[call_at + 8] = 0x90;
  EXPECT_FALSE(exit_at(code).callee);
}

TEST(CodeOfFunction, FunctionThatMayReturnBeforeItsCallHasNoCallee) {
  Instructions code = wrapper;
  code[14 - 1] = 0x74, code[14] = 0x10, code[15] = 0x90;  // je beyond the call
  EXPECT_FALSE(exit_at(code).callee);
}

// Of Fast DDS 2.9.1 as Debian compiles it.
TEST(CodeOfFunction, GetterTellsTheOffsetOfItsMember) {
  const Instructions returns{0x48, 0x8b, 0x47, 0x30, 0xc3};  // mov 0x30(%rdi), %rax; ret
  const Instructions calls{0x48, 0x8b, 0x7f, 0x48, 0xe9,
                           0x00, 0x01, 0x00, 0x00};  // mov 0x48(%rdi), %rdi; jmp
  const Instructions marked{0xf3, 0x0f, 0x1e, 0xfa, 0x48,
                            0x8b, 0x47, 0x30, 0xc3};  // endbr64, as Ubuntu compiles it
  EXPECT_EQ(offset_of_member({returns, address, true}), 0x30U);
  EXPECT_EQ(offset_of_member({calls, address, true}), 0x48U);
  EXPECT_EQ(offset_of_member({marked, address, true}), 0x30U);
}

TEST(CodeOfFunction, FunctionThatDoesMoreThanReturnAMemberIsRefused) {
  const Instructions of_another{0x48, 0x8b, 0x46, 0x30, 0xc3};  // mov 0x30(%rsi), %rax; ret
  const Instructions chained{0x48, 0x8b, 0x47, 0x30,
                             0x48, 0x8b, 0x00, 0xc3};  // mov 0x30(%rdi), %rax; mov (%rax), %rax; ret
  const Instructions table{0x48, 0x8b, 0x07, 0xc3};    // mov (%rdi), %rax; ret
  for (const auto& code : {of_another, chained, table, Instructions{0xc3}, Instructions{}})
    EXPECT_FALSE(offset_of_member({code, address, true}));
}

// rmw_take_with_info() of rmw_fastrtps_cpp: a jump to a function with one argument more.
TEST(CodeOfFunction, TailCallIsProbedAtTheJump) {
  const Instructions code{
      0x4d, 0x89, 0xc1,              // mov %r8, %r9
      0x49, 0x89, 0xc8,              // mov %rcx, %r8
      0x48, 0x89, 0xd1,              // mov %rdx, %rcx
      0x48, 0x89, 0xf2,              // mov %rsi, %rdx
      0x48, 0x89, 0xfe,              // mov %rdi, %rsi
      0x48, 0x8b, 0x00,              // mov (%rax), %rax
      0x48, 0x89, 0xc7,              // mov %rax, %rdi
      0xe9, 0x00, 0x01, 0x00, 0x00,  // jmp
  };
  const auto entry = entry_at(code, {0, 2, 3});
  EXPECT_TRUE(entry.is_cheap);
  EXPECT_EQ(entry.offset, 21U);
  EXPECT_THAT(entry.registers, ::testing::ElementsAre(ontime_argument_2, 0, ontime_argument_4, ontime_r8));
  EXPECT_TRUE(exit_at(code).is_cheap);
  EXPECT_EQ(exit_at(code).offset, 21U);
}

TEST(CodeOfFunction, LeadingPushIsProbed) {
  const Instructions code{0x55, 0x5d, 0xc3};  // push %rbp; pop %rbp; ret
  EXPECT_TRUE(begins_cheaply({code, address, true}));
  EXPECT_TRUE(entry_at(code, {0}).is_cheap);
  EXPECT_TRUE(exit_at(code).is_cheap);
  EXPECT_EQ(exit_at(code).offset, 0U);
}

TEST(CodeOfFunction, LoopIsNotProbed) {
  const Instructions code{0x31, 0xc0,  // xor %eax, %eax
                          0x90,        // nop
                          0x75, 0xfd,  // jne to the nop
                          0xc3};
  EXPECT_FALSE(entry_at(code, {0}).is_cheap);
  EXPECT_EQ(entry_at(code, {0}).offset, 0U);
}

TEST(CodeOfFunction, PartialCodeIsProbedAtItsFirstByte) {
  EXPECT_EQ(entry_at(wrapper, {0, 2}, false).offset, 0U);
  EXPECT_FALSE(exit_at(wrapper, false).callee);
  EXPECT_EQ(exit_at(wrapper, false).offset, 0U);
}

TEST(CodeOfFunction, EmptyCodeIsProbedAtItsFirstByte) {
  EXPECT_EQ(entry_at({}, {0}).offset, 0U);
  EXPECT_EQ(exit_at({}).offset, 0U);
  EXPECT_FALSE(begins_cheaply({}));
}

}  // namespace
}  // namespace ontime::listen
#endif
