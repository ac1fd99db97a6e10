"""What draws, infers and traces on this machine, whether it does so rightly, and how long it takes."""
