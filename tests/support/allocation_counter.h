#pragma once

namespace wagonsight::testing_support {

// How often this thread has asked the heap for memory through operator new. Link
// allocation_counter.cpp into the program that asks.
long allocation_count();

}  // namespace wagonsight::testing_support
