"""`run`, from the consent to the page of results."""
