// A design as CXXRTL simulates it, for the harness of streams.
#include "harness.h"

namespace {

void set(value<1> &port, bool bit) { port.data[0] = bit; }

struct Model {
    Design top;
    Model() { set(top.CLOCK, true); }
    bool settle() { return evaluate(top); }
    void edge() { top.commit(); }
};

}  // namespace
