"""What a picture shows that was not expected."""
