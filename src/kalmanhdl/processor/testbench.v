// Loads program.hex into the core, feeds it input.hex by its handshake and holds what it puts out against
// expected.hex. The words WIDTH, PROGRAM_WORDS, INPUTS and OUTPUTS are defined above; +inputs and +outputs say
// that the files have fewer numbers.
module testbench;
  reg clk = 0, rst = 1;
  reg [31:0] program_words [0:`PROGRAM_WORDS-1];
  reg [`WIDTH-1:0] inputs [0:`INPUTS-1];
  reg [`WIDTH-1:0] expected [0:`OUTPUTS-1];
  integer loaded = 0, given = 0, taken = 0, wrong = 0, idle = 0;
  integer inputs_there = `INPUTS, outputs_there = `OUTPUTS;
  reg drdy_i = 0, ack_o = 1, drdy_before = 0, waiting = 0;
  wire program_ready, ack_i, drdy_o;
  wire [`WIDTH-1:0] data_out;

  controller dut (
    .clk(clk), .rst(rst),
    .program_word(loaded < `PROGRAM_WORDS ? program_words[loaded] : 32'd0),
    .program_last(loaded == `PROGRAM_WORDS - 1), .program_valid(!rst && loaded < `PROGRAM_WORDS),
    .program_ready(program_ready),
    .data_in(given < inputs_there ? inputs[given] : {`WIDTH{1'b0}}), .DRDY_I(drdy_i), .ACK_I(ack_i),
    .data_out(data_out), .DRDY_O(drdy_o), .ACK_O(ack_o)
  );

  initial begin
    if (!$value$plusargs("inputs=%d", inputs_there)) inputs_there = `INPUTS;
    if (!$value$plusargs("outputs=%d", outputs_there)) outputs_there = `OUTPUTS;
    $readmemh("program.hex", program_words);
    $readmemh("input.hex", inputs);
    $readmemh("expected.hex", expected);
    repeat (4) #5 clk = ~clk;
    rst = 0;
    forever #5 clk = ~clk;
  end

  always @(posedge clk) if (!rst) begin
    if (loaded < `PROGRAM_WORDS && program_ready) loaded <= loaded + 1;
    // Input: the next number once ACK_I has fallen again.
    if (drdy_i && ack_i) begin
      drdy_i <= 0;
      given <= given + 1;
      waiting <= 1;
    end else if (waiting) waiting <= ack_i;
    else if (given < inputs_there) drdy_i <= 1;
    // Output: ACK_O falls when DRDY_O rises, and rises when the number is taken.
    drdy_before <= drdy_o;
    if (drdy_o && !drdy_before) ack_o <= 0;
    else if (!ack_o) begin
      ack_o <= 1;
      if (data_out !== expected[taken]) begin
        wrong = wrong + 1;
        $display("output %0d is %h and should be %h", taken, data_out, expected[taken]);
      end
      taken = taken + 1;
      idle = 0;
      if (taken == outputs_there) begin
        $display("%0d outputs, %0d wrong", taken, wrong);
        if (wrong != 0) $fatal(1);
        $finish;
      end
    end else idle = idle + 1;
    if (idle > 1000000) begin
      $display("stuck after %0d outputs", taken);
      $fatal(1);
    end
  end
endmodule
