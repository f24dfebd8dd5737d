"""Programs as vector code: lines of LLVM, and the loop around them."""
