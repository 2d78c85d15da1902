// One logic element a bit: in its arithmetic mode it makes a sum and passes a carry on.
(* techmap_celltype = "$alu" *)
module _80_logic_element_alu(A, B, CI, BI, X, Y, CO);
  parameter A_SIGNED = 0;
  parameter B_SIGNED = 0;
  parameter A_WIDTH = 1;
  parameter B_WIDTH = 1;
  parameter Y_WIDTH = 1;
  (* force_downto *) input [A_WIDTH-1:0] A;
  (* force_downto *) input [B_WIDTH-1:0] B;
  input CI, BI;
  (* force_downto *) output [Y_WIDTH-1:0] X, Y, CO;
  (* force_downto *) wire [Y_WIDTH-1:0] a, b;
  \$pos #(.A_SIGNED(A_SIGNED), .A_WIDTH(A_WIDTH), .Y_WIDTH(Y_WIDTH)) widen_a (.A(A), .Y(a));
  \$pos #(.A_SIGNED(B_SIGNED), .A_WIDTH(B_WIDTH), .Y_WIDTH(Y_WIDTH)) widen_b (.A(B), .Y(b));
  // A subtraction known as such inverts inside the element; a choice between the two takes a table more.
  parameter _TECHMAP_CONSTMSK_BI_ = 0;
  parameter _TECHMAP_CONSTVAL_BI_ = 0;
  localparam SUBTRACT = _TECHMAP_CONSTMSK_BI_ && _TECHMAP_CONSTVAL_BI_;
  (* force_downto *) wire [Y_WIDTH-1:0] second = SUBTRACT ? b : b ^ {Y_WIDTH{BI}};
  (* force_downto *) wire [Y_WIDTH:0] carry = {CO, CI};
  genvar i;
  generate
    for (i = 0; i < Y_WIDTH; i = i + 1) begin : bits
      LOGIC_ELEMENT_ADDER #(.INVERT_B(SUBTRACT))
        adder (.A(a[i]), .B(second[i]), .CI(carry[i]), .S(Y[i]), .CO(CO[i]));
    end
  endgenerate
  assign X = a ^ b ^ {Y_WIDTH{BI}};
endmodule
