(function () {
  "use strict";
  var day = document.getElementById("day"), gone = document.getElementById("gone"), tag = "";
  function look() {
    fetch("part", {cache: "no-store", headers: tag ? {"If-None-Match": tag} : {}}).then(function (answer) {
      gone.hidden = true;
      if (answer.status !== 200) { return null; }
      tag = answer.headers.get("ETag");
      return answer.text().then(function (text) { day.innerHTML = text; });
    }).catch(function () { gone.hidden = false; }).then(function () { setTimeout(look, 1000); });
  }
  look();
})();
