// Sends the steps of stimulus.csv through a design in Verilator and holds what comes out against expected.csv,
// in the folder that it is given. README.md says what stands in the tables. It needs Verilator 5, C++17 and the
// headers beside this file: pairs.h and top.h name the design's ports and its model.
#include <algorithm>
#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>
#include "model.h"

namespace {

#include "pairs.h"

using Words = std::vector<uint64_t>;
using Row = std::map<std::string, std::string>;

constexpr int RESET_CLOCKS = 4;
// Clocks in which nothing moves before the design counts as stuck.
constexpr int64_t PATIENCE = 10000;

struct Failure : std::runtime_error {
    using runtime_error::runtime_error;
};

// A port that carries a number: where its words are in a token, low word first, and what they stand for.
struct Port {
    std::string column, name, signal;
    size_t width, begin;
    bool is_signed, real;
    double last_bit;

    size_t words() const { return (width + 63) / 64; }
    std::string text(const Words &token) const;
};

// A row of a table: the clocks of pause before it, and the clock in which it is due, or -1.
struct Token {
    size_t line;
    int64_t pause, clock;
    Words words;
};

using Tokens = std::vector<Token>;
using Places = std::map<std::pair<std::string, std::string>, Tokens>;

struct Stream {
    std::string prefix;
    std::vector<Port> inputs, outputs;
    Tokens sent, expected;
    size_t accepted = 0, taken = 0;
    int64_t in_pause = 0, out_pause = 0;
    bool offering = false, taking = false;

    void load(Tokens to_send, Tokens to_expect) {
        sent = std::move(to_send);
        expected = std::move(to_expect);
        accepted = taken = 0;
        offering = taking = false;
        in_pause = pause(sent, 0);
        out_pause = pause(expected, 0);
    }
    bool done() const { return accepted == sent.size() && taken == expected.size(); }
    static int64_t pause(const Tokens &tokens, size_t at) { return at < tokens.size() ? tokens[at].pause : 0; }
};

std::string Port::text(const Words &token) const {
    char digits[32];
    std::string hexadecimal;
    for (size_t i = words(); i-- > 0;) {
        size_t bits = i + 1 == words() ? width - 64 * i : 64;
        std::snprintf(digits, sizeof digits, "%0*" PRIx64, int((bits + 3) / 4), token[begin + i]);
        hexadecimal += digits;
    }
    if (width > 64) return "0x" + hexadecimal;
    uint64_t raw = token[begin];
    bool negative = is_signed && raw >> (width - 1);
    std::ostringstream out;
    out.precision(9);
    out << "0x" << hexadecimal << " (";
    if (negative && width < 64) raw -= uint64_t(1) << width;
    if (negative) out << int64_t(raw);
    else out << raw;
    if (real) out << " = " << (negative ? double(int64_t(raw)) : double(raw)) * last_bit;
    out << ")";
    return out.str();
}

// A line of a table, as cells: a cell may be quoted.
std::vector<std::string> cells(const std::string &line) {
    std::vector<std::string> found(1);
    bool quoted = false;
    for (char c : line) {
        if (c == '"') quoted = !quoted;
        else if (c == ',' && !quoted) found.emplace_back();
        else found.back() += c;
    }
    return found;
}

std::vector<Row> table(const std::string &path) {
    std::ifstream file(path);
    if (!file) throw Failure(path + ": cannot be read: name the folder of the tables");
    std::string line;
    std::getline(file, line);
    const std::vector<std::string> names = cells(line);
    std::vector<Row> rows;
    while (std::getline(file, line)) {
        const std::vector<std::string> found = cells(line);
        if (found.size() != names.size()) throw Failure(path + ": this is no row of the table: " + line);
        rows.emplace_back();
        for (size_t i = 0; i < names.size(); i++) rows.back()[names[i]] = found[i];
    }
    return rows;
}

void append(Words &words, const std::string &digits, const Port &port) {
    for (size_t i = 0; i < port.words(); i++) {
        size_t end = digits.size() > 16 * i ? digits.size() - 16 * i : 0, begin = end > 16 ? end - 16 : 0;
        words.push_back(end ? std::stoull(digits.substr(begin, end - begin), nullptr, 16) : 0);
    }
}

std::vector<Stream> streams(const std::vector<Row> &rows) {
    std::vector<Stream> found;
    for (const Row &row : rows) {
        if (found.empty() || found.back().prefix != row.at("stream")) {
            found.emplace_back();
            found.back().prefix = row.at("stream");
        }
        bool in = row.at("column").rfind("in_", 0) == 0;
        std::vector<Port> &ports = in ? found.back().inputs : found.back().outputs;
        const std::string &last_bit = row.at("last_bit");
        size_t begin = ports.empty() ? 0 : ports.back().begin + ports.back().words();
        ports.push_back({row.at("column"), row.at("port"), row.at("signal"), std::stoul(row.at("width")), begin,
                         row.at("signed") == "1", !last_bit.empty(), std::atof(last_bit.c_str())});
    }
    if (found.size() != PAIRS) throw Failure("ports.csv: has other streams than pairs.h");
    return found;
}

Places tokens(const std::vector<Row> &rows, const std::vector<Port> &ports) {
    Places found;
    size_t line = 1;
    for (const Row &row : rows) {
        auto clock = row.find("clock");
        bool due = clock != row.end() && !clock->second.empty();
        Token token{++line, std::stoll(row.at("pause")), due ? std::stoll(clock->second) : -1, {}};
        for (const Port &port : ports) append(token.words, row.at(port.column), port);
        found[{row.at("section"), row.at("stream")}].push_back(std::move(token));
    }
    return found;
}

struct Bench {
    // Its inputs begin at zero, where those of held.csv stay.
    Model model;
    std::vector<Stream> streams;
    int64_t clock = 0;

    template <size_t k>
    void drive() {
        Stream &stream = streams[k];
        // An offer once made stands until it is accepted.
        if (!stream.offering && stream.accepted < stream.sent.size()) {
            stream.offering = stream.in_pause == 0;
            stream.in_pause = std::max<int64_t>(0, stream.in_pause - 1);
            if (stream.offering) Pair<k>::send(model, stream.sent[stream.accepted].words.data());
        }
        stream.taking = stream.taken < stream.expected.size() && stream.out_pause == 0;
        stream.out_pause = std::max<int64_t>(0, stream.out_pause - 1);
        Pair<k>::offer(model, stream.offering);
        Pair<k>::take(model, stream.taking);
    }

    template <size_t k>
    bool look() {
        Stream &stream = streams[k];
        bool accepted = stream.offering && Pair<k>::accepted(model);
        bool taken = stream.taking && Pair<k>::offered(model);
        if (accepted) {
            stream.in_pause = Stream::pause(stream.sent, ++stream.accepted);
            stream.offering = false;
        }
        if (taken) {
            Words words(stream.outputs.back().begin + stream.outputs.back().words());
            Pair<k>::receive(model, words.data());
            check(stream, stream.expected[stream.taken], words);
            stream.out_pause = Stream::pause(stream.expected, ++stream.taken);
        }
        return accepted || taken;
    }

    template <size_t k>
    void check_silence() {
        if (streams[k].expected.empty() || !Pair<k>::offered(model)) return;
        fail(streams[k].prefix + "out_valid: expected no further result after " +
             std::to_string(streams[k].taken) + ", got one");
    }

    void check(const Stream &stream, const Token &token, const Words &words) const {
        std::string step = "step " + std::to_string(stream.taken) + ", ";
        std::string line = " (expected.csv, line " + std::to_string(token.line) + "): expected ";
        for (const Port &port : stream.outputs) {
            auto begin = words.begin() + port.begin;
            if (std::equal(begin, begin + port.words(), token.words.begin() + port.begin)) continue;
            fail(step + port.name + ", " + port.signal + line + port.text(token.words) + ", got " +
                 port.text(words));
        }
        if (token.clock >= 0 && token.clock != clock)
            fail(step + stream.prefix + "out_valid" + line + "in clock " + std::to_string(token.clock) +
                 " after reset, got");
    }

    [[noreturn]] void fail(const std::string &what) const {
        throw Failure(what + " in clock " + std::to_string(clock));
    }

    // One clock; whether anything was transferred in it.
    template <size_t... k>
    bool step(bool looking, std::index_sequence<k...>) {
        (drive<k>(), ...);
        if (!model.settle()) fail("it does not settle");
        bool moved = looking && (look<k>() | ...);
        model.edge();
        return moved;
    }

    template <size_t... k>
    void silence(std::index_sequence<k...> all) {
        (drive<k>(), ...);
        if (!model.settle()) fail("it does not settle");
        (check_silence<k>(), ...);
        model.edge();
    }

    void section(const std::string &name, int64_t wait, Places &sent, Places &expected) {
        constexpr std::make_index_sequence<PAIRS> all;
        for (Stream &stream : streams) stream.load({}, {});
        reset(model, true);
        for (int i = 0; i < RESET_CLOCKS; i++) step(false, all);
        reset(model, false);
        for (Stream &stream : streams)
            stream.load(sent[{name, stream.prefix}], expected[{name, stream.prefix}]);
        int64_t idle = 0;
        for (clock = 0; !done(); clock++) {
            idle = step(true, all) ? 0 : idle + 1;
            if (idle >= PATIENCE) fail("stuck: nothing moved for " + std::to_string(PATIENCE) + " clocks" + progress());
        }
        for (int64_t end = clock + wait; clock < end; clock++) silence(all);
    }

    bool done() const {
        return std::all_of(streams.begin(), streams.end(), [](const Stream &stream) { return stream.done(); });
    }

    std::string progress() const {
        std::string text;
        for (const Stream &stream : streams)
            text += ", " + stream.prefix + ": " + std::to_string(stream.accepted) + " of " +
                    std::to_string(stream.sent.size()) + " steps taken, " + std::to_string(stream.taken) + " of " +
                    std::to_string(stream.expected.size()) + " results given";
        return text;
    }
};

int run(const std::string &folder) {
    Bench bench;
    bench.streams = streams(table(folder + "/ports.csv"));
    Places sent = tokens(table(folder + "/stimulus.csv"), bench.streams[0].inputs);
    Places expected = tokens(table(folder + "/expected.csv"), bench.streams[0].outputs);
    for (const Row &row : table(folder + "/sections.csv")) {
        const std::string &name = row.at("section");
        try {
            bench.section(name, std::stoll(row.at("wait")), sent, expected);
        } catch (const Failure &failure) {
            throw Failure("section " + name + ", " + failure.what());
        }
        std::cout << "section " << name << ": " << bench.clock << " clocks, as expected\n";
    }
    return 0;
}

}  // namespace

int main(int count, char **arguments) {
    try {
        return run(count > 1 ? arguments[1] : ".");
    } catch (const std::exception &error) {
        std::cerr << "ERROR: " << error.what() << "\n";
        return 1;
    }
}
