#pragma once

namespace wagonsight::bench {

// How often this thread has called malloc, calloc, realloc or an aligned form of them.
long heap_calls();

}  // namespace wagonsight::bench
