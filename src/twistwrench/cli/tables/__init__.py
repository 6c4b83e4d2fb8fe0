"""What commands print: tables of results."""
