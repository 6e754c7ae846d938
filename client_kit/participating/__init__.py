"""`run`, from consent to the result page."""
