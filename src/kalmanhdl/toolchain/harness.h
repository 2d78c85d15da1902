// What every harness shares: memories, and words in and out of ports.
#include <algorithm>
#include <cxxrtl/cxxrtl.h>

namespace cxxrtl_design {

// Hides the runtime's memory, which searches a queue for the place of every write.
template <size_t Width>
struct memory : cxxrtl::memory<Width> {
    using Base = cxxrtl::memory<Width>;
    using Base::Base;
    using Base::operator=;

    void update(size_t index, const cxxrtl::value<Width> &val, const cxxrtl::value<Width> &mask, int priority = 0) {
        this->write_queue.push_back({index, val, mask, priority});
    }

    template <class Observer>
    bool commit(Observer &) {
        auto &queue = this->write_queue;
        if (queue.size() > 1)
            std::stable_sort(queue.begin(), queue.end(), [](auto &a, auto &b) { return a.priority < b.priority; });
        for (auto &write : queue) this->data[write.index] = this->data[write.index].update(write.val, write.mask);
        queue.clear();
        return true;
    }
};

}  // namespace cxxrtl_design

#include "design.cc"
#include "ports.h"

namespace {

using namespace cxxrtl;
using Design = cxxrtl_design::TOP;

template <size_t Bits>
void put(value<Bits> &port, const uint64_t *words) {
    for (size_t i = 0; i < value<Bits>::chunks; i++)
        port.data[i] = uint32_t(words[i / 2] >> (32 * (i % 2)));
    port.data[value<Bits>::chunks - 1] &= value<Bits>::msb_mask;
}

template <size_t Bits>
void get(const value<Bits> &port, uint64_t *words) {
    for (size_t i = 0; i < value<Bits>::chunks; i++)
        words[i / 2] = i % 2 ? words[i / 2] | uint64_t(port.data[i]) << 32 : port.data[i];
}

template <size_t Bits>
void get(const wire<Bits> &port, uint64_t *words) { get<Bits>(port.curr, words); }

bool bit(const value<1> &port) { return port.data[0]; }
bool bit(const wire<1> &port) { return port.curr.data[0]; }

// The clock stays high and only looks as if it had been low: one evaluation a cycle, in which the
// outputs still belong to the time before the edge.
bool evaluate(Design &top) {
    top.CLOCK_BEFORE.data[0] = 0;
    return top.eval();
}

}  // namespace

#define EXPORT extern "C" __attribute__((visibility("default")))
