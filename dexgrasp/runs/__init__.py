"""What long work shares: folders that are claimed and resumed, workers, interrupts, versions."""
