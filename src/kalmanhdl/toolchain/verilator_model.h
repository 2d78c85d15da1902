// A design as Verilator simulates it, for the harness.
#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include "top.h"

double sc_time_stamp() { return 0; }

// Verilator ends the process where a design does not settle; VL_USER_FATAL leaves that to us.
void vl_fatal(const char *, int, const char *, const char *message) { throw std::runtime_error(message); }

namespace {

template <size_t Bits, typename Port>
void put(Port &port, const uint64_t *words) { port = Port(words[0]); }

template <size_t Bits, size_t Words>
void put(VlWide<Words> &port, const uint64_t *words) {
    for (size_t i = 0; i < Words; i++) port[i] = uint32_t(words[i / 2] >> (32 * (i % 2)));
}

template <size_t Bits, typename Port>
void get(const Port &port, uint64_t *words) { words[0] = port; }

template <size_t Bits, size_t Words>
void get(const VlWide<Words> &port, uint64_t *words) {
    for (size_t i = 0; i < Words; i++)
        words[i / 2] = i % 2 ? words[i / 2] | uint64_t(port[i]) << 32 : port[i];
}

void set(CData &port, bool bit) { port = bit; }
bool bit(CData port) { return port; }

struct Model {
    VerilatedContext context;
    Top top{&context};
    bool settle() {
        top.clk = 0;
        return evaluate();
    }
    void edge() {
        top.clk = 1;
        evaluate();
    }
    bool evaluate() {
        try {
            top.eval();
        } catch (const std::runtime_error &) {
            return false;
        }
        return true;
    }
};

}  // namespace

#define EXPORT extern "C" __attribute__((visibility("default")))
